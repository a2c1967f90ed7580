"""Flights in full: what a policy saw and did in each decision, what that paid and cost, and the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym import SatInertiaIDVectorEnv
from satid_gym.gym_api import COSTS
from satid_gym.policy import Policy, observation_settings, only_mission, show_filter
from satid_gym.problem import problem
from satid_gym.resolution import InertiaLike
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario

TRUTH = (
    "time",
    "inertia_true",
    "inertia_estimate",
    "relative_error",
    "nees",
    "information_held",
    "cost",
    "outside",
    "saturated",
    "torque_applied",
)
"""Keys of `info` that are recorded in addition to the costs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Episode:
    """One flight of T decisions.

    Attributes:
        seed: of the environment.
        observations: (T + 1, size) float32, from the start on.
        actions: (T, n) float32.
        rewards: (T,).
        terminations, truncations: (T,) bool.
        infos: arrays (T + 1, ...) by name, from the start on, and "costs" by theirs.
    """

    seed: int
    observations: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    terminations: np.ndarray
    truncations: np.ndarray
    infos: Mapping[str, Any]


def record(
    policy: Policy,
    *,
    satellite: Satellite,
    inertia: InertiaLike,
    scenario: Scenario,
    control: str,
    seeds: Sequence[int],
    include_covariance: bool,
) -> list[Episode]:
    """Fly one policy, episodes side by side.

    Args:
        policy: that decides. It sees what it asks for.
        satellite, inertia, scenario, control: as for the environment.
        seeds: one per episode.
        include_covariance: whether observations are recorded with the filter's whole covariance, which policies that do
            not ask for it are not shown.

    Raises:
        ValueError: the policy cannot fly there.
    """
    seen = observation_settings(policy)
    recorded = {**seen, "include_covariance": include_covariance or seen["include_covariance"]}
    mission = only_mission(problem(satellite, inertia, scenario, control=control, **seen))
    size = max(place.stop for place in mission.layout.values())  # the covariance's parts are the last ones
    policy.reset(mission, seeds)
    env = SatInertiaIDVectorEnv(len(seeds), satellite, inertia, scenario, control=control, **recorded)
    observation, info = env.reset(seed=list(seeds))
    steps: dict[str, list[np.ndarray]] = {"observations": [observation]}
    infos = [_chosen(info)]
    for _ in range(mission.scenario.decisions):
        show_filter(policy, env.fleet.rows.beliefs, env.fleet.rows.tasks)
        action = np.asarray(policy(observation[:, :size]), np.float32)
        observation, *results, info = env.step(action)
        named = ("actions", "rewards", "terminations", "truncations", "observations")
        for name, value in zip(named, (action, *results, observation), strict=True):
            steps.setdefault(name, []).append(value)
        infos.append(_chosen(info))
    env.close()
    flown = {name: np.stack(values, axis=1) for name, values in steps.items()}  # episodes first
    told = {name: np.stack([info[name] for info in infos], axis=1) for name in infos[0]}
    over = flown["terminations"] | flown["truncations"]
    return [
        Episode(
            seed=seed,
            observations=flown["observations"][i, : end + 1],
            infos={name: value[i, : end + 1] for name, value in told.items() if name not in COSTS}
            | {"costs": {name: told[name][i, : end + 1] for name in COSTS}},
            **{name: values[i, :end] for name, values in flown.items() if name != "observations"},
        )
        for i, (seed, end) in enumerate(zip(seeds, over.argmax(axis=1) + 1, strict=True))
    ]


def _chosen(info: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """What is recorded of a vector environment's infos, (N, ...) each; costs by their names."""
    return {name: info[name] for name in TRUTH} | {name: info["costs"][name] for name in COSTS}
