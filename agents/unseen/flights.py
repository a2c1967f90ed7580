"""Flights on drawn satellites: what is kept of each, and one policy over another, satellite by satellite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from satid_gym.evaluation import FIRST_SEED, Split, benchmark_scenario, fly
from satid_gym.metrics import BEYOND_MAX
from satid_gym.policies.learned.shipped import find
from satid_gym.policies.registry import BASELINES, PLANNERS, RATE_BASELINES, RATE_PLANNERS, build
from satid_gym.policy import Policy
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario

LIMITS = ("outside_fraction", "saturated_fraction", "cost")  # the last is the largest of all costs
KEPT = ("mean_error", "final_error", *LIMITS, "nees", "terminated")
Row = dict[str, Any]  # a policy in a cell: satellite, wheels, inertia, policy, and a list of episodes of each of KEPT


def world_of(scenario: str, split: Split) -> Scenario:
    """Scenario of the benchmark by name, whose data sheets of panels are draws of a split of seeds.

    Those of tuning are the scenario's own, on which policies are trained.
    """
    world = benchmark_scenario(scenario)
    if world.appendages is None or split == "tuning":
        return world
    return world.replace(appendages=world.appendages.replace(seed=FIRST_SEED[split]))


def flown(policy: Policy, world: Scenario, satellite: Satellite, inertia: str, seeds: Sequence[int]) -> Row:
    """Scores of one policy in the episodes of a satellite with an inertia mode, by body rates, with the full tensor."""
    scores = fly(
        policy,
        satellite=satellite,
        inertia=inertia,
        seeds=seeds,
        scenario=world,
        control="rate",
    ).scores()
    cell = {"satellite": satellite.name, "wheels": satellite.wheels.count, "inertia": inertia, "policy": policy.name}
    return cell | {name: [float(f"{value:.4g}") for value in scores[name]] for name in KEPT}


def policy_of(name: str, tuned: Mapping[str, Mapping[str, float]]) -> Policy:
    """Baseline with the settings that tuning found, or a learned policy by name or path.

    Raises:
        ValueError: no policy has that name, or it is a baseline that was not tuned.
    """
    if name in tuned:
        return build(name, dict(tuned[name]))
    if name in {**BASELINES, **RATE_BASELINES}:
        raise ValueError(
            f"baseline {name!r} was not tuned on drawn satellites, only {', '.join(tuned)}: add its settings to GRIDS "
            "of agents.unseen.tune and run that"
        )
    return find(name)


def episodes_of(name: str, episodes: int, planned: int) -> int:
    """Episodes that a policy flies in a cell: planners, which are slow, fly fewer."""
    return min(planned, episodes) if name in (*PLANNERS, *RATE_PLANNERS) else episodes


def by_satellite(rows: Sequence[Row], policy: str, score: str) -> dict[str, float]:
    """Mean score of a policy by satellite, over laws and their episodes."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row["policy"] == policy:
            found.setdefault(row["satellite"], []).append(float(np.mean(row[score])))
    return {satellite: float(np.mean(values)) for satellite, values in found.items()}


def ratios(rows: Sequence[Row], policy: str, other: str, score: str = "mean_error") -> np.ndarray:
    """Score of a policy over that of another, one number a satellite that both have flown.

    Each is the geometric mean over the inertia modes of the ratio of means over the episodes that both have flown.
    """
    cells = {(row["satellite"], row["inertia"], row["policy"]): row[score] for row in rows}
    found: dict[str, list[float]] = {}
    for (satellite, inertia, name), own in cells.items():
        theirs = cells.get((satellite, inertia, other))
        if name == policy and theirs is not None:
            shared = min(len(own), len(theirs))
            found.setdefault(satellite, []).append(np.log(np.mean(own[:shared]) / np.mean(theirs[:shared])))
    return np.array([np.exp(np.mean(values)) for values in found.values()])


def inside(rows: Sequence[Row], policy: str, score: str) -> float:
    """Share of the satellites on which a policy is outside for at most 1 % of the time; `score` says of what."""
    return float(np.mean([value <= BEYOND_MAX for value in by_satellite(rows, policy, score).values()]))
