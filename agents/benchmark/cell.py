"""Cell of a comparison, one satellite with one inertia mode, while its policies fly."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any

from baselines.studies.performance_bound import PerformanceBound, performance_bound
from baselines.studies.timing import TimedPolicy
from satid_gym.estimators import MomentumEKFSettings
from satid_gym.evaluation import Flight, fly
from satid_gym.laws import InertiaLaw
from satid_gym.policy import Policy
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.selection import label


@dataclass(frozen=True, eq=False, kw_only=True)
class Cell:
    """Flights of one cell that are under way, or wait for a free core.

    Attributes:
        satellite, inertia: which cell.
        policies: the entrants.
        flights: of each of them, with the time of its decisions, ms.
        performance_bound: errors that the cell allows; None where the scenario's filter is neither the AdaptiveEKF
            nor the MomentumEKF, as they are by default.
    """

    satellite: Satellite
    inertia: str | InertiaLaw
    policies: Sequence[Policy]
    flights: Sequence[Future[tuple[Flight, float]]]
    performance_bound: Future[PerformanceBound] | None

    @property
    def place(self) -> dict[str, str]:
        """Its satellite and inertia mode as records have them."""
        return {"satellite": self.satellite.name, "inertia_mode": label(self.inertia)}

    @classmethod
    def start(
        cls,
        pool: Executor,
        policies: Sequence[Policy],
        *,
        satellite: Satellite,
        inertia: str | InertiaLaw,
        seeds: Sequence[int],
        scenario: Scenario,
    ) -> Cell:
        """Hand a cell to the pool."""
        episodes = {"satellite": satellite, "inertia": inertia, "seeds": seeds, "scenario": scenario, "num_threads": 1}
        bounded = isinstance(scenario.estimator, MomentumEKFSettings) and not scenario.faults.possible
        return cls(
            satellite=satellite,
            inertia=inertia,
            policies=policies,
            performance_bound=pool.submit(performance_bound, satellite, inertia, seeds, scenario) if bounded else None,
            flights=[pool.submit(fly_timed, policy, **episodes) for policy in policies],
        )


def fly_timed(policy: Policy, **episodes: Any) -> tuple[Flight, float]:
    """Flight of a copy of the policy, because cells fly side by side, and the time of its decisions, ms."""
    timed = TimedPolicy(copy.copy(policy))
    return fly(timed, **episodes), timed.decision_ms
