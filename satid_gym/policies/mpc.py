"""Model-predictive excitation: each decision the rate plan with the least expected error, with what the filter knows.

A plan says for every decision of the horizon to which side each axis turns: information grows with the square of
the rate, so between reversals the rate belongs at the limit. It minimises the relative error of the inertia that
the filter expects, mean over the horizon: by the error itself a plan pays more for a deep fall of certainty than by
its logarithm, log det, and reverses axes together. The plan of the decision before, one decision on, is improved by
local search; its first decision is flown.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.planner import ADAPTIVE_WALK, PLANNING_MARGIN, Planner
from satid_gym.control.rate_loop import RateLoop
from satid_gym.interface import seed_stream
from satid_gym.policy import Kind, Mission

_FIRST_REVERSALS = (10, 17, 24)  # decision, by axis, of the plan that the search begins with


class MPCPolicy:
    """Receding-horizon A-optimal design.

    Args:
        horizon: decisions ahead.
        steps: of the forecast in each decision.
        edits: of the plan that are tried in each decision.
        margin: of the rate loop, see `RateLoop`.
        walk: of the inertia, per sqrt(s), that it plans with where the scenario's filter is an AdaptiveEKF.

    Raises:
        ValueError: horizon, steps or edits is not a whole number of at least 1, or margin or walk is negative.
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
    ) -> None:
        if not all(isinstance(value, int) and value >= 1 for value in (horizon, steps, edits)):
            raise ValueError(
                "horizon, steps and edits must be whole numbers of at least 1, "
                f"got {horizon!r}, {steps!r} and {edits!r}"
            )
        self.horizon, self.steps, self.edits = horizon, steps, edits
        self.margin, self.walk = check_number("margin", margin), check_number("walk", walk)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Take in the satellite and its noise; every search begins with the same plan."""
        self._loop = RateLoop([mission], self.margin)
        self._planner = Planner(mission, len(seeds), self.steps, self.margin, self.walk)
        self._streams = np.stack([seed_stream(np.random.default_rng([seed, 3])) for seed in seeds])
        self._left = mission.scenario.decisions
        ahead = np.arange(self.horizon)[:, None]
        self._plans = np.tile(np.where(ahead < _FIRST_REVERSALS, 1.0, -1.0), (len(seeds), 1, 1))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        return self._loop(observation, self.plan(observation))

    def plan(self, observation: np.ndarray) -> np.ndarray:
        """Rate command (N, 3), each -1 or 1, for the decision that the observation (N, size) begins."""
        self._search(observation)
        return self._advance()

    def weigh(self, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The plan's command (N, 3), and what each of its sides is worth: see `Planner.advantage`."""
        ahead = self._search(observation)
        advantage = self._planner.advantage(self._plans, ahead)
        return self._advance(), advantage

    def _search(self, observation: np.ndarray) -> int:
        """Improve the plans; the decisions that they look ahead, as far as the episode goes."""
        self._planner.observe(observation)
        ahead = max(1, min(self.horizon, self._left))
        self._planner.improve(self._plans, self._streams, self.edits, ahead)
        return ahead

    def _advance(self) -> np.ndarray:
        """What the plans begin with; they move on by a decision."""
        command = self._plans[:, 0].copy()
        self._plans[:, :-1] = self._plans[:, 1:]
        self._left -= 1
        return command
