"""Policies: one protocol for scripted, closed-loop and learned excitation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from satid_gym.core.observation import Form
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.problem import Problem
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario, prior_of

Kind = Literal["scripted", "closed_loop", "learned", "reference"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Mission:
    """Briefing of a policy before an episode: what its designer would know, without the truth.

    Attributes:
        satellite: nominal, with the limits and sensors it is operated with.
        prior: prior of the filter.
        estimator: settings of the filter that is flown.
        scenario: world of the episode.
        layout: slices of the observation by name.
        control: what an action is, "torque" of each wheel or body "rate".
        observation: its form, as in `Problem`.
    """

    satellite: Satellite
    prior: FilterPrior
    estimator: EstimatorSettings
    scenario: Scenario
    layout: dict[str, slice]
    control: str = "torque"
    observation: Form = "wheels"

    @property
    def actions(self) -> int:
        """Number of entries of an action."""
        return self.satellite.wheels.count if self.control == "torque" else 3


def missions(problem: Problem) -> list[Mission]:
    """One mission for each satellite of a problem."""
    scenario, places = problem.scenario, problem.layout
    return [
        Mission(
            satellite=scenario.operate(satellite),
            prior=prior_of(satellite, scenario),
            estimator=problem.estimator,
            scenario=scenario,
            layout=places,
            control=problem.control,
            observation=problem.observation,
        )
        for satellite in problem.satellites
    ]


def only_mission(problem: Problem) -> Mission:
    """Mission of a problem's only satellite, or of its first data sheet where a scenario has drawn several for it.

    A policy sees the differences between the data sheets, panels and tanks, only in the observation.

    Raises:
        ValueError: the problem has several satellites.
    """
    first, *others = (satellite.replace(oscillators=()) for satellite in problem.satellites)
    if any(other != first for other in others):
        names = list(dict.fromkeys(satellite.name for satellite in problem.satellites))
        raise ValueError(f"a policy is prepared for one satellite, and the problem has {names}: fly each separately")
    return missions(problem)[0]


class Policy(Protocol):
    """Choice of actions for a batch of parallel episodes.

    A policy with a true attribute `include_covariance` gets observations with the filter's whole covariance, one whose
    attribute `observation` is "body" the body-frame form, and one with a true attribute `include_walk` also the
    filter's random walk of the inertia. A `FilterPlanner`, which plans with the flying filter, is shown its records
    before each decision, see `show_filter`.

    Attributes:
        name: name in tables.
        kind: scripted, closed_loop, learned or reference.
    """

    name: str
    kind: Kind

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for len(seeds) episodes that start together; a random policy draws from the seeds alone."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n), or (N, 3) body rates, in [-1, 1] for observations (N, size)."""


def check_commands_rates(mission: Mission, name: str) -> None:
    """Check that the environment takes body rates, which a policy commands.

    Raises:
        ValueError: it takes torques.
    """
    if mission.control != "rate":
        raise ValueError(f'{name} commands body rates: make the environment with control="rate"')


def observation_settings(policy: Policy) -> dict[str, Any]:
    """Settings of an environment or problem that give the observations a policy needs."""
    return {
        "include_covariance": bool(getattr(policy, "include_covariance", False)),
        "observation": getattr(policy, "observation", "wheels"),
        "include_walk": bool(getattr(policy, "include_walk", False)),
    }


@runtime_checkable
class FilterPlanner(Policy, Protocol):
    """Policy that plans with the flying filter, whose whole state it sees and not only the observation."""

    def see(self, beliefs: np.ndarray, tasks: np.ndarray) -> None:
        """Take note of the records (N,) of filter and task, before the observation of the same decision."""


def show_filter(policy: Policy, beliefs: np.ndarray, tasks: np.ndarray) -> None:
    """Show a `FilterPlanner` the flying filters (N,); other policies see nothing. Neither record contains the truth."""
    if isinstance(policy, FilterPlanner):
        policy.see(beliefs, tasks)
