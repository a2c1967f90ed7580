"""Cell of a comparison, one satellite with one inertia mode, while its policies fly."""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any

from baselines.studies.performance_bound import PerformanceBound, lacks_bound, performance_bound
from baselines.studies.timing import TimedPolicy
from satid_gym.evaluation import Flight, fly
from satid_gym.laws import InertiaLaw
from satid_gym.policy import Mission, Policy, missions, observation_settings
from satid_gym.problem import problem
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
        performance_bound: errors that the cell allows; None where it has no bound, see
            `baselines.studies.performance_bound.lacks_bound`.
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
        control: str,
    ) -> Cell:
        """Hand a cell to the pool."""
        flies = functools.partial(
            fly_timed,
            satellite=satellite,
            inertia=inertia,
            seeds=seeds,
            scenario=scenario,
            control=control,
            num_threads=1,
        )
        bounded = not lacks_bound(problem(satellite, inertia, scenario))
        return cls(
            satellite=satellite,
            inertia=inertia,
            policies=policies,
            performance_bound=pool.submit(performance_bound, satellite, inertia, seeds, scenario) if bounded else None,
            flights=[pool.submit(flies, policy) for policy in policies],
        )


def fly_timed(policy: Policy, **episodes: Any) -> tuple[Flight, float]:
    """Flight of a copy of the policy, because cells fly side by side, and the time of its decisions, ms."""
    timed = TimedPolicy(copy.copy(policy))
    return fly(timed, **episodes), timed.decision_ms


def misfit(
    policy: Policy, satellite: Satellite, modes: Sequence[str | InertiaLaw], scenario: Scenario, control: str
) -> str:
    """Why a policy cannot fly a satellite, such as other numbers of wheels or parameters; "" where it can."""
    for mode in modes:
        told = _mission(satellite, mode, scenario, control, tuple(observation_settings(policy).items()))
        try:
            copy.copy(policy).reset(told, [0])
        except ValueError as error:
            return f"satellite {satellite.name!r}: {error}"
    return ""


@functools.lru_cache(maxsize=64)
def _mission(satellite: Satellite, mode: str | InertiaLaw, scenario: Scenario, control: str, seen: Any) -> Mission:
    """Briefing of the first data sheet that a scenario draws, which takes it a second; policies share them."""
    return missions(problem(satellite, mode, scenario, control=control, **dict(seen)))[0]
