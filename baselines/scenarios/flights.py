"""Flights of a gate: what a policy's episodes cost, and how well the filter comes to know the inertia."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym import metrics
from satid_gym.evaluation import stepped_and_turning
from satid_gym.fleet import Fleet
from satid_gym.gym_api import COSTS
from satid_gym.policy import Policy, missions, observation_settings, show_filter
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.vector import SatInertiaIDVectorEnv

Told = Callable[[SatInertiaIDVectorEnv, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class AnyCell:
    """Scenario and satellite, by their names or themselves, and inertia mode, by its name."""

    scenario: str | Scenario
    satellite: str | Satellite
    inertia: str


@dataclass(frozen=True, kw_only=True)
class Cell(AnyCell):
    """Cell of the catalogues: scenario and satellite by their names, which tables and files have."""

    scenario: str
    satellite: str


@dataclass(frozen=True)
class Flown:
    """Scores of N episodes.

    Attributes:
        expected: relative error that the filter expects, geometric mean over the inertia's parameters and mean over
            the flight; infinite where it ended early.
        error: relative error at the end, or when it ended.
        nees: normalised estimation error squared, mean over the time that was flown and in which a filter can know the
            inertia (`satid_gym.metrics.settled`).
        costs: (N, costs) mean over the time that was flown, of which the decision that ended it is part.
        terminated: whether it ended early; no cost says so.
        expected_at_end: relative error that the filter expects then; infinite where it ended early.
    """

    expected: np.ndarray
    error: np.ndarray
    nees: np.ndarray
    costs: np.ndarray
    terminated: np.ndarray
    expected_at_end: np.ndarray

    def inside(self, limit: float) -> bool:
        """Whether no episode ended early and each cost, in the mean over episodes, is at most a limit."""
        return not self.terminated.any() and bool(self.costs.mean(axis=0).max() <= limit)

    def first(self, count: int) -> Flown:
        """The first `count` episodes."""
        return self.take(np.arange(count))

    def take(self, rows: np.ndarray) -> Flown:
        """The episodes of these numbers."""
        return Flown(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def flown(
    cell: AnyCell, policy: Policy, seeds: Sequence[int], told: Told | None = None, *, num_threads: int | None = None
) -> Flown:
    """Scores of a policy that commands rates; `told` may change what it observes.

    Errors are in units of the rotors' mean inertia: a factor on all of them and on the inertia, which no excitation
    finds, is in neither. What the filter expects is the geometric mean of the parameters' std, from the determinant of
    their covariance.
    """
    settings = {"control": "rate", "num_threads": num_threads, **observation_settings(policy)}
    env = SatInertiaIDVectorEnv(len(seeds), cell.satellite, cell.inertia, cell.scenario, **settings)
    policy.reset(missions(env.problem)[0], seeds)
    observation, info = env.reset(seed=list(seeds))
    count, steps = len(seeds), env.problem.scenario.decisions
    alive, error = np.ones(count, bool), np.zeros(count)
    expected, costs = np.zeros(count), np.zeros((count, len(COSTS)))
    now, lived, nees = np.zeros(count), np.zeros(count), np.full((steps, count), np.nan)
    stepped, turning = np.zeros((2, steps, count), bool)
    for t in range(steps):
        if told is not None:
            observation = told(env, observation)
        show_filter(policy, env.fleet.rows.beliefs, env.fleet.rows.tasks)
        observation, _, terminated, _, info = env.step(policy(observation))
        lived += alive
        error = np.where(alive, unit_free_error(env.fleet), error)
        now = np.where(alive, expected_error(env), np.inf)
        expected += now / steps
        stepped[t], turning[t] = stepped_and_turning(env.fleet.rows.plants, env.fleet.rows.tasks)
        nees[t, alive] = info["nees"][alive]
        costs += np.where(alive[:, None], np.stack([info["costs"][name] for name in COSTS], axis=1), 0.0)
        alive &= ~terminated
    env.close()
    consistency = metrics.consistency(nees, metrics.settled(stepped, turning, env.problem.scenario.decision_period))
    return Flown(expected, error, consistency, costs / lived[:, None], ~alive, np.where(alive, now, np.inf))


def expected_error(env: SatInertiaIDVectorEnv) -> np.ndarray:
    """Geometric mean (N,) of the parameters' std over their scale."""
    beliefs = env.fleet.rows.beliefs
    scale = beliefs["theta_scale"]
    p = scale.shape[1]
    covariance = beliefs["covariance"][:, 3 : 3 + p, 3 : 3 + p]
    return np.exp(0.5 * np.linalg.slogdet(covariance)[1] / p - np.log(scale).mean(axis=1))


def unit_free_error(fleet: Fleet) -> np.ndarray:
    """Relative error (N,) of the estimate, times the factor of the true rotors' mean inertia, which is often 1."""
    rows = fleet.rows
    factor = (rows.plants["wheel_inertia"] / rows.beliefs["wheel_inertia"]).mean(axis=1)
    true = rows.reports["inertia_true"].reshape(len(factor), -1)
    estimate = rows.reports["inertia_estimate"].reshape(len(factor), -1)
    return np.linalg.norm(factor[:, None] * estimate - true, axis=1) / np.linalg.norm(true, axis=1)
