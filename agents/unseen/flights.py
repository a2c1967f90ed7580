"""Flights on drawn satellites: what is kept of each, and one policy over another, satellite by satellite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from satid_gym.evaluation import benchmark_scenario, fly
from satid_gym.metrics import BEYOND_MAX
from satid_gym.policies.learned.shipped import find
from satid_gym.policies.registry import PLANNERS, RATE_BASELINES, RATE_PLANNERS, build
from satid_gym.policy import Policy
from satid_gym.satellite import Satellite

LIMITS = ("outside_fraction", "saturated_fraction", "cost")  # the last is the largest of all costs
KEPT = ("mean_error", "final_error", *LIMITS, "nees")
Row = dict[str, Any]  # a policy in a cell: satellite, wheels, inertia, policy, and a list of episodes of each of KEPT


def flown(policy: Policy, scenario: str, satellite: Satellite, inertia: str, seeds: Sequence[int]) -> Row:
    """Scores of one policy in the episodes of a satellite with an inertia mode, by body rates, with the full tensor."""
    scores = fly(
        policy,
        satellite=satellite,
        inertia=inertia,
        seeds=seeds,
        scenario=benchmark_scenario(scenario),
        control="rate",
    ).scores()
    cell = {"satellite": satellite.name, "wheels": satellite.wheels.count, "inertia": inertia, "policy": policy.name}
    return cell | {name: [float(f"{value:.4g}") for value in scores[name]] for name in KEPT}


def policy_of(name: str, tuned: Mapping[str, Mapping[str, float]]) -> Policy:
    """Baseline with the settings that tuning found, or a learned policy by name or path.

    Raises:
        ValueError: no policy has that name.
    """
    return build(name, dict(tuned.get(name, {}))) if name in (*tuned, *RATE_BASELINES) else find(name)


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


def inside(rows: Sequence[Row], policy: str, score: str = "outside_fraction") -> float:
    """Share of the satellites on which a policy is outside for at most 1 % of the time; `score` says of what."""
    return float(np.mean([value <= BEYOND_MAX for value in by_satellite(rows, policy, score).values()]))
