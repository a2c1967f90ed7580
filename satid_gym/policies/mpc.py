"""Model-predictive excitation: at each decision the rate plan with the least expected error, from the filter's belief.

A plan gives the sign of each axis's rate for every decision of the horizon: information grows with the square of
the rate, so between reversals the rate should be at its limit. The cost is the relative error of the inertia that
the filter expects, mean over the horizon: a short loss of certainty costs more by the error itself than by its
logarithm (log det), so the axes of a plan reverse together. The plan of the previous decision, shifted by one decision,
is improved by local search; its first decision is flown.

Where operators avoid a band of wheel speed, the error of a step with a wheel in it counts many times, and rates of a
plan may be smaller than the limit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_flag, check_number
from satid_gym.control.planning.planner import ADAPTIVE_WALK, CLEARANCE, PLANNING_MARGIN, Planner
from satid_gym.control.rate_loop import rate_loop
from satid_gym.gym_api import planner_streams
from satid_gym.policy import Kind, Mission

_FIRST_REVERSALS = (10, 17, 24)  # decision of each axis's reversal in the initial plan


class MPCPolicy:
    """Receding-horizon A-optimal excitation.

    Args:
        horizon: number of decisions ahead.
        steps: integration steps of the forecast per decision.
        edits: changes of the plan tried per decision.
        margin: margin of the rate loop, see `RateLoop`.
        walk: inertia walk of the forecast, per sqrt(s), if the scenario's filter is adaptive.
        amplitude: of the rates, over what the envelope allows.
        clearance: that plans keep from a band of wheel speed that operators avoid, over the speed limit.
        include_walk: whether the forecast takes in its place the walk that the filter uses at the time, observed.

    Raises:
        ValueError: horizon, steps or edits is not an integer of at least 1, or margin or walk is negative.
    """

    name = "mpc"
    kind: Kind = "closed_loop"

    def __init__(
        self,
        horizon: int = 40,
        steps: int = 2,
        edits: int = 24,
        margin: float = PLANNING_MARGIN,
        walk: float = ADAPTIVE_WALK,
        amplitude: float = 1.0,
        clearance: float = CLEARANCE,
        include_walk: bool = False,
    ) -> None:
        if not all(isinstance(value, int) and value >= 1 for value in (horizon, steps, edits)):
            raise ValueError(
                f"horizon, steps and edits must be integers of at least 1, got {horizon!r}, {steps!r} and {edits!r}"
            )
        self.horizon, self.steps, self.edits = horizon, steps, edits
        self.include_walk = check_flag("include_walk", include_walk)
        self.amplitude = check_number("amplitude", amplitude, high=1.0, strict=True)
        self.clearance = check_number("clearance", clearance, high=1.0)
        self.margin, self.walk = check_number("margin", margin), check_number("walk", walk)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the rate loop, the planner and the initial plan, which is the same for every episode."""
        self._loop = rate_loop([mission], self.margin)
        self._planner = Planner(mission, len(seeds), self.steps, self.margin, self.walk, self.amplitude, self.clearance)
        self._streams = planner_streams(seeds)
        self._left = mission.scenario.decisions
        ahead = np.arange(self.horizon)[:, None]
        self._plans = np.tile(np.where(ahead < _FIRST_REVERSALS, 1.0, -1.0), (len(seeds), 1, 1))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        return self._loop(observation, self.amplitude * self.plan(observation))

    def plan(self, observation: np.ndarray) -> np.ndarray:
        """Rate command (N, 3) for the decision after the observation (N, size).

        Each is -1 or 1, or smaller where wheels avoid a band of speed.
        """
        self._search(observation)
        return self._advance()

    def weigh(self, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Command (N, 3) of the plan, and the value of each of its sides, see `Planner.side_value`."""
        ahead = self._search(observation)
        side_value = self._planner.side_value(self._plans, ahead)
        return self._advance(), side_value

    def _search(self, observation: np.ndarray) -> int:
        """Improve the plans; returns the number of decisions ahead, at most those left in the episode."""
        self._planner.observe(observation)
        ahead = max(1, min(self.horizon, self._left))
        self._planner.improve(self._plans, self._streams, self.edits, ahead)
        return ahead

    def _advance(self) -> np.ndarray:
        """First command (N, 3) of the plans, which are then shifted by a decision."""
        command = self._plans[:, 0].copy()
        self._plans[:, :-1] = self._plans[:, 1:]
        self._left -= 1
        return command
