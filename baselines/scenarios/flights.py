"""Flights of a gate: what a policy's episodes cost, and how well the filter comes to know the inertia."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.gym_api import COSTS
from satid_gym.policy import Policy, missions, observation_settings
from satid_gym.vector import SatInertiaIDVectorEnv

Told = Callable[[SatInertiaIDVectorEnv, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Scenario, satellite and inertia mode, by their names."""

    scenario: str
    satellite: str
    inertia: str


@dataclass(frozen=True)
class Flown:
    """Scores of N episodes.

    Attributes:
        expected: relative error that the filter expects, mean over the flight; infinite where it ended early.
        error: relative error at the end, or when it ended.
        nees: normalised estimation error squared, mean over the flight.
        costs: (N, costs).
        terminated: whether it ended early.
    """

    expected: np.ndarray
    error: np.ndarray
    nees: np.ndarray
    costs: np.ndarray
    terminated: np.ndarray

    def first(self, count: int) -> Flown:
        """The first so many episodes."""
        return Flown(*(getattr(self, name)[:count] for name in self.__dataclass_fields__))


def flown(cell: Cell, policy: Policy, seeds: Sequence[int], told: Told | None = None) -> Flown:
    """Scores of a policy that commands rates; `told` may change what it observes."""
    settings = {"control": "rate", **observation_settings(policy)}
    env = SatInertiaIDVectorEnv(len(seeds), cell.satellite, cell.inertia, cell.scenario, **settings)
    policy.reset(missions(env.problem)[0], seeds)
    observation, info = env.reset(seed=list(seeds))
    moments = env.problem.layout["inertia"].stop - env.problem.layout["inertia"].start
    count, steps = len(seeds), env.problem.scenario.decisions
    alive, error = np.ones(count, bool), np.zeros(count)
    expected, nees, costs = np.zeros(count), np.zeros(count), np.zeros((count, len(COSTS)))
    lived = np.zeros(count)
    for _ in range(steps):
        if told is not None:
            observation = told(env, observation)
        observation, _, terminated, _, info = env.step(policy(observation))
        lived += alive
        error = np.where(alive, info["relative_error"], error)
        expected += np.where(alive, np.exp(-info["information_held"] / moments), np.inf) / steps
        nees += np.where(alive, info["nees"], 0.0)
        costs += np.where(alive[:, None], np.stack([info["costs"][name] for name in COSTS], axis=1), 1.0) / steps
        alive &= ~terminated
    env.close()
    return Flown(expected, error, nees / lived, costs, ~alive)
