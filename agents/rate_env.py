"""The training environment: actions are what the network commands, body rates or wheel torque."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from gymnasium import spaces

from satid_gym.control.rate_loop import RateLoop
from satid_gym.policy import missions
from satid_gym.sb3 import SatInertiaIDVecEnv


class RateCommandVecEnv(SatInertiaIDVecEnv):
    """Actions are body rates, as fractions of what the envelope allows; the rate loop turns them into torque.

    Args:
        num_envs: how many.
        margin: of the rate loop; None passes actions on as wheel torque.
        **settings: of `SatInertiaIDVecEnv`.
    """

    def __init__(self, num_envs: int, *, margin: float | None, **settings: Any) -> None:
        super().__init__(num_envs, **settings)
        self.seconds = 0.0
        self._loop = None if margin is None else RateLoop(missions(self.vector_env.problem), margin)
        self._observations = np.zeros((num_envs, *self.observation_space.shape), np.float32)
        self._rows = np.full(num_envs, -1)
        if self._loop is not None:
            self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)

    def reset(self) -> np.ndarray:
        """Start an episode in every environment."""
        self._observations = super().reset()
        return self._observations

    def step_async(self, actions: np.ndarray) -> None:
        """Turn commands into torque and keep them for `step_wait`."""
        start = time.perf_counter()
        if self._loop is not None:
            rows = self.vector_env.satellite_index
            if not np.array_equal(rows, self._rows):
                self._loop.assign(rows)
                self._rows = rows
            actions = self._loop(self._observations, actions)
        super().step_async(actions)
        self.seconds += time.perf_counter() - start

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take one decision in every environment."""
        start = time.perf_counter()
        result = super().step_wait()
        self._observations = result[0]
        self.seconds += time.perf_counter() - start
        return result

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go back to a `state`."""
        super().restore(state)
        self._observations = state["observations"].copy()
        self._rows = np.full(self.num_envs, -1)
