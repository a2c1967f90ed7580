"""Model-predictive excitation: each decision the D-optimal rate plan is found anew with what the filter knows.

A plan says for each axis when it reverses next: information grows with the square of the rate, so between
reversals the rate belongs at the limit. The plan of the decision before, one decision on, is improved axis by
axis over all times in the horizon; its first decision is flown. It maximises what the filter will know, the
mean of log det of the inertia's information over the horizon.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baselines.planner import Planner
from baselines.rate_loop import RateLoop
from satid_gym.config import check_number
from satid_gym.policy import Kind, Mission


class MPCPolicy:
    """Receding-horizon D-optimal design.

    Args:
        horizon: decisions ahead.
        steps: of the forecast in each decision.
        margin: of the rate loop, see `RateLoop`.

    Raises:
        ValueError: horizon or steps is not a whole number of at least 1, or the margin is negative.
    """

    name = "mpc"
    kind: Kind = "closed_loop"

    def __init__(self, horizon: int = 10, steps: int = 2, margin: float = 2.75) -> None:
        if not all(isinstance(value, int) and value >= 1 for value in (horizon, steps)):
            raise ValueError(f"horizon and steps must be whole numbers of at least 1, got {horizon!r} and {steps!r}")
        self.horizon, self.steps = horizon, steps
        self.margin = check_number("margin", margin)
        delays = [0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32]
        self._delays = np.array([*(d for d in delays if d < horizon), horizon])

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Take in the satellite and its noise; every plan begins with full rate on all axes and no reversal."""
        self._loop = RateLoop([mission], self.margin)
        self._left = mission.scenario.decisions
        self._planner = Planner(mission, len(seeds), self.steps, self.margin)
        self._side = np.ones((len(seeds), 3))
        self._delay = np.full((len(seeds), 3), self.horizon)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        self._planner.observe(observation)
        rows, keep = np.arange(len(observation)), np.minimum(self._delay, self.horizon)
        for axis in range(3):
            delays = np.repeat(keep[:, None], len(self._delays) + 1, axis=1)
            delays[:, 1:, axis] = self._delays
            held = self._planner.forecast(self._commands(delays)).held
            keep = delays[rows, held.argmax(axis=1)]
        command = np.where(keep == 0, -self._side, self._side)
        self._side = command
        self._left -= 1
        self._delay = np.where(keep == 0, self.horizon, np.where(keep == self.horizon, keep, keep - 1))
        return self._loop(observation, command)

    def _commands(self, delays: np.ndarray) -> np.ndarray:
        """(N, C, H, 3) of plans (N, C, 3), as far as the episode goes."""
        ahead = np.arange(max(1, min(self.horizon, self._left)))
        reversed_ = ahead[:, None] >= delays[:, :, None, :]
        return np.where(reversed_, -1.0, 1.0) * self._side[:, None, None, :]
