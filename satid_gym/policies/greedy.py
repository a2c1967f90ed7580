"""Greedy maximiser of information: the body rates with the largest forecast gain over the next decisions.

At each decision it forecasts every combination of full rate, zero and full negative rate on the three axes, held over
the horizon, and commands the one whose filter updates gain most information. A horizon of one decision is the greedy
policy proper; a longer horizon looks past the low rates during a reversal.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.planning.planner import PLANNING_MARGIN, Planner
from satid_gym.control.rate_loop import rate_loop
from satid_gym.policy import Kind, Mission

_CANDIDATES = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))


class GreedyPolicy:
    """Maximiser of the information gained in the next `horizon` decisions.

    Args:
        name: its name in tables.
        horizon: number of decisions ahead.
        steps: integration steps of the forecast per decision.
        margin: margin of the rate loop, see `RateLoop`.

    Raises:
        ValueError: horizon or steps is not an integer of at least 1, or the margin is negative.
    """

    kind: Kind = "closed_loop"

    def __init__(self, name: str, horizon: int, steps: int = 2, margin: float = PLANNING_MARGIN) -> None:
        if not all(isinstance(value, int) and value >= 1 for value in (horizon, steps)):
            raise ValueError(f"horizon and steps must be integers of at least 1, got {horizon!r} and {steps!r}")
        self.name, self.horizon, self.steps = name, horizon, steps
        self.margin = check_number("margin", margin)
        self._commands = np.repeat(_CANDIDATES[None, :, None, :], horizon, axis=2)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the rate loop and the planner for the satellite."""
        self._loop = rate_loop([mission], self.margin)
        self._left = mission.scenario.decisions
        self._planner = Planner(mission, len(seeds), self.steps, self.margin)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        self._planner.observe(observation)
        ahead = max(1, min(self.horizon, self._left))  # not beyond the end of the episode
        information = self._planner.forecast(self._commands[:, :, :ahead]).gained
        self._left -= 1
        return self._loop(observation, _CANDIDATES[information.argmax(axis=1)])
