"""Model-predictive excitation with the whole filter: what it plans, the filter that flies has rehearsed.

`mpc` forecasts with a rigid body, nominal sensors and no star tracker, from what it observes. This one rehearses with
the filter's own records (`control.planning.rehearsal`): it sees modes ring, stars come into sight and errors of gyro
and wheels become known, and keeps deflections inside their limit for frequencies within `caution` standard deviations
of the estimate. With no caution it is certainty-equivalent. Between decisions a plan of rates is shifted by one and
improved by local search.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_integer, check_number
from satid_gym.control.planning.rehearsal import Flights, Scratch, Trail, sizes
from satid_gym.control.planning.rehearsal_search import Search, improve_rehearsed
from satid_gym.control.rate_loop import RateMargin
from satid_gym.core.truth.star_tracker import tracker_dtype
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.records import new_work
from satid_gym.gym_api import planner_streams
from satid_gym.policy import Kind, Mission, check_commands_rates
from satid_gym.templates import write_tracker

_FIRST = 10  # times as many edits of the first plan, which no earlier one prepares


class FilterMPCPolicy:
    """Receding-horizon excitation that the flying filter rehearses; for control "rate" and the MomentumEKF.

    Defaults look far enough ahead for stops at which a star tracker sees. Where the body bends, horizon 16, edits 24
    and tail 5 are better (the gate of scenarios "flex" and "slosh").

    Args:
        horizon: decisions ahead.
        edits: changes of the plan that are tried in a decision.
        tail: decisions that the plan's last error counts for in addition to its own.
        caution: standard deviations of a mode's frequency for which the body must not bend too far.
        amplitude: of the rates, over what the envelope allows.
        step: s from one expected reading to the next. Where the body bends or readings come late, all are taken.
        margin: see `RateMargin`.

    Raises:
        ValueError: a setting is out of range.
    """

    name = "filter_mpc"
    kind: Kind = "closed_loop"
    observation = "body"
    _EDITS_MIN = 1

    def __init__(
        self,
        horizon: int = 40,
        edits: int = 16,
        tail: float = 20.0,
        caution: float = 1.0,
        amplitude: float = 1.0,
        step: float = 0.5,
        margin: float = 3.5,
    ) -> None:
        self.horizon, self.edits = (
            check_integer("horizon", horizon, low=2),
            check_integer("edits", edits, low=self._EDITS_MIN),
        )
        self.tail, self.caution = check_number("tail", tail), check_number("caution", caution)
        self.amplitude = check_number("amplitude", amplitude, high=1.0, strict=True)
        self.step, self.margin = check_number("step", step, strict=True), check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or its filter is not a MomentumEKF.
        """
        check_commands_rates(mission, self.name)
        if not isinstance(mission.estimator, MomentumEKFSettings):
            raise ValueError(
                f"{self.name} rehearses with the MomentumEKF, and the filter is {type(mission.estimator).__name__}: "
                'make the environment with estimator="momentum", or fly swing_and_stop, shaped_square or rate_square'
            )
        world, tracker, n = mission.scenario, mission.satellite.sensors.star_tracker, len(seeds)
        self._shares = self.amplitude * RateMargin([mission], self.margin)(np.zeros((1, 0)), np.ones(3))[0]
        self._trackers = np.zeros(n, tracker_dtype())
        if tracker is not None:
            for row in self._trackers:
                write_tracker(row, tracker, world)
        self._every = self._trackers["every"].copy()
        self._streams = planner_streams(seeds)
        self._stride = _divisor(world.samples, self.step / world.sample_period)
        self._plans, self._left = np.zeros((n, self.horizon, 3)), world.decisions
        self._first, self._seen = True, False

    def see(self, beliefs: np.ndarray, tasks: np.ndarray) -> None:
        """Take note of the records (N,) of filter and task."""
        flights = Flights(beliefs.copy(), tasks.copy(), self._trackers)
        self._trackers["sun"] = tasks["sun"]
        if sizes(flights)[1] == 0 and beliefs["alignment"]["gyro_line"].size == 0:  # delays are counted in samples
            _lengthen(flights, self._stride)
            self._trackers["every"] = np.maximum(1, self._every // self._stride)
        self._flights, self._seen = flights, True

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3).

        Raises:
            RuntimeError: `see` was not called since the last decision.
        """
        flights = self._flown()
        return self._planned(flights, np.empty((len(flights.beliefs), 0, self._ahead, 3)))

    @property
    def _ahead(self) -> int:
        """Decisions of the plan."""
        return max(2, min(self.horizon, self._left))

    def _flown(self) -> Flights:
        """What was seen for this decision.

        Raises:
            RuntimeError: nothing was.
        """
        if not self._seen:
            raise RuntimeError(
                f"{self.name} plans with the filter's records: call satid_gym.policy.show_filter before each decision, "
                "or fly it by a Pilot, by `satid fly`, satid_gym.evaluation.fly or baselines.scenarios.gate"
            )
        self._seen = False
        return self._flights

    def _planned(self, flights: Flights, proposals: np.ndarray) -> np.ndarray:
        """Action (N, 3) of the best plan found, of the last one, proposals (N, K, H, 3) and their edits."""
        ahead, shares = self._ahead, self._shares
        plans = self._plans[:, :ahead].copy()
        trails = Trail.of(flights, ahead + 1), Trail.of(flights, ahead + 1)
        search = Search(self.edits * (_FIRST if self._first else 1), self.tail, self.caution)
        improve_rehearsed(flights, plans, proposals, shares, trails, scratch_of(flights), self._streams, search)
        self._plans[:, :ahead] = plans
        self._plans[:, :-1] = self._plans[:, 1:]
        self._left, self._first = self._left - 1, False
        return plans[:, 0] * shares


def _divisor(samples: int, wanted: float) -> int:
    """Largest divisor of a decision's samples that is not larger than what is wanted, at least 1."""
    return max(d for d in range(1, samples + 1) if samples % d == 0 and (d == 1 or d <= wanted * (1.0 + 1e-9)))


def _lengthen(flights: Flights, stride: int) -> None:
    """Let one reading stand for `stride` of them, with the noise of their mean."""
    flights.beliefs["gyro_std"] /= np.sqrt(stride)
    flights.beliefs["wheel_momentum_covariance"] /= stride
    flights.tasks["sample_period"] *= stride
    flights.tasks["samples"] //= stride


def scratch_of(flights: Flights) -> Scratch:
    """Scratch space for the rehearsals of flights."""
    p = flights.beliefs["prior_theta"].shape[1]
    return Scratch(new_work(flights.beliefs), np.zeros(3), np.zeros(sizes(flights)[0]), np.zeros(4), np.zeros((p, p)))
