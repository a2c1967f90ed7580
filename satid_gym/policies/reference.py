"""Reference policies that every excitation must beat: random actions, and none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.policy import Kind, Mission

_STREAM = 1  # makes the policy's draws independent of the environment's for the same seed


class RandomPolicy:
    """Actions uniform within their limits, a new draw for each decision from the episodes' seeds."""

    name = "random"
    kind: Kind = "reference"

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Draw the actions of every episode from its own seed."""
        shape = (mission.scenario.decisions, mission.actions)
        draws = [np.random.default_rng([seed, _STREAM]).uniform(-1.0, 1.0, shape) for seed in seeds]
        self._actions = np.stack(draws, axis=1)
        self._decision = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        self._decision += 1
        return self._actions[self._decision - 1]


class ZeroPolicy:
    """Zero torque, or rest: excitation by the motors' noise and the disturbance alone."""

    name = "zero"
    kind: Kind = "reference"

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Note the size of an action."""
        self._actions = mission.actions

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        return np.zeros((len(observation), self._actions))
