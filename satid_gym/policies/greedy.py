"""Greedy information maximiser: the body rates that teach the filter most over the next decisions.

Each decision it tries every combination of full rate, rest and full rate backward on the three axes, held over
the horizon, and commands the one whose updates gain most by its own forecast. One decision is the greedy
policy proper; a longer horizon sees past the swing that a reversal costs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.planner import PLANNING_MARGIN, Planner
from satid_gym.control.rate_loop import RateLoop
from satid_gym.policy import Kind, Mission

_CANDIDATES = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))


class GreedyPolicy:
    """Maximises the information that the next `horizon` decisions gain.

    Args:
        name: what tables call it.
        horizon: decisions ahead.
        steps: of the forecast in each decision.
        margin: of the rate loop, see `RateLoop`.

    Raises:
        ValueError: horizon or steps is not a whole number of at least 1, or the margin is negative.
    """

    kind: Kind = "closed_loop"

    def __init__(self, name: str, horizon: int, steps: int = 2, margin: float = PLANNING_MARGIN) -> None:
        if not all(isinstance(value, int) and value >= 1 for value in (horizon, steps)):
            raise ValueError(f"horizon and steps must be whole numbers of at least 1, got {horizon!r} and {steps!r}")
        self.name, self.horizon, self.steps = name, horizon, steps
        self.margin = check_number("margin", margin)
        self._commands = np.repeat(_CANDIDATES[None, :, None, :], horizon, axis=2)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Take in the satellite and its noise."""
        self._loop = RateLoop([mission], self.margin)
        self._left = mission.scenario.decisions
        self._planner = Planner(mission, len(seeds), self.steps, self.margin)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        self._planner.observe(observation)
        ahead = max(1, min(self.horizon, self._left))  # as far as the episode goes
        gained = self._planner.forecast(self._commands[:, :, :ahead]).gained
        self._left -= 1
        return self._loop(observation, _CANDIDATES[gained.argmax(axis=1)])
