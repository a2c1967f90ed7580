"""Interface of Gymnasium, as the single and the vector environment share it: spaces, info, options, actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from satid_gym.config import unknown_name
from satid_gym.core.observation import BOUND
from satid_gym.core.records import Cost
from satid_gym.laws import InertiaLaw
from satid_gym.oscillators import oscillator_counts
from satid_gym.problem import Problem
from satid_gym.resolution import resolve_inertia, resolve_satellites
from satid_gym.templates import EpisodeTemplates, build_templates

_PLANNER = 3  # of a random stream, so that it has other draws than the environment of the same seed
RESET_OPTIONS = ("satellite", "inertia", "true_inertia")
INFO_KEYS = (
    "time",
    "inertia_true",
    "inertia_estimate",
    "relative_error",
    "nees",
    "nis",
    "information_gain",
    "information_held",
    "outside",
    "costs",
    "cost",
    "effort",
    "in_avoided_band",
    "tracking",
    "saturated",
    "torque_applied",
    "constrained_updates",
    "rejected",
    "nis_mean",
    "colour",
    "unmodelled",
    "inflation",
    "restarts",
    "inertia_walk",
    "steps_found",
    "faults",
    "deflection",
)
COSTS = tuple(cost.name.lower() for cost in Cost)
"""Names of the costs."""
_FLAGS = ("saturated", "faults", "unmodelled")  # keys whose values are bool, or arrays of it


def make_spaces(p: Problem) -> tuple[spaces.Box, spaces.Box]:
    """Observation and action space of one environment."""
    size = max(place.stop for place in p.layout.values())
    return (
        spaces.Box(-BOUND, BOUND, (size,), np.float32),
        spaces.Box(-1.0, 1.0, (p.actions,), np.float32),
    )


def seed_stream(rng: np.random.Generator) -> np.ndarray:
    """First state (4,) of an environment's random stream, from its generator."""
    return rng.integers(1, 2**64, size=4, dtype=np.uint64)


def planner_streams(seeds: Sequence[int]) -> np.ndarray:
    """First states (N, 4) of a planner's random streams, one for each episode, apart from the environments'."""
    return np.stack([seed_stream(np.random.default_rng([seed, _PLANNER])) for seed in seeds])


def seed_list(seed: int | Sequence[int | None] | None, count: int) -> list[int | None]:
    """Seeds of `count` environments: from s the i-th gets s + i, from a list its own entry, from None no seed.

    Raises:
        ValueError: the list has another length.
    """
    if seed is None:
        seeds: list[int | None] = [None] * count
    elif isinstance(seed, (Sequence, np.ndarray)) and not isinstance(seed, str):
        seeds = [int(s) if isinstance(s, np.integer) else s for s in seed]
    elif isinstance(seed, (int, np.integer)):
        seeds = [int(seed) + i for i in range(count)]
    else:
        seeds = [seed] * count  # Gymnasium's own generator refuses it
    if len(seeds) != count:
        raise ValueError(f"seed must be one number or {count} of them, got {len(seeds)}")
    return seeds


def real_action(name: str, value: object) -> np.ndarray:
    """An agent's action as float32; values that overflow are infinite.

    Raises:
        ValueError: it is not numeric.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.array(None)  # rows of different lengths
    if array.dtype.kind not in "iufb":
        raise ValueError(f"{name} must be numbers, got {value!r}")
    with np.errstate(over="ignore"):
        return array.astype(np.float32, order="C")  # always a copy: numba compiles again for read-only or strided ones


def info_of(reports: np.ndarray) -> dict[str, Any]:
    """Info of the single environment, from its only report."""
    report = dict(zip(reports.dtype.names or (), reports.item(), strict=True))
    info = {key: report[key] for key in INFO_KEYS}
    info["costs"] = dict(zip(COSTS, report["costs"].tolist(), strict=True))
    for key, value in info.items():
        if isinstance(value, np.ndarray):
            info[key] = value.astype(bool) if key in _FLAGS else value.copy()
        elif key in _FLAGS:
            info[key] = bool(value)
    return info


def infos_of(reports: np.ndarray, mask: np.ndarray) -> dict[str, Any]:
    """Infos of a vector environment, from the reports (N,) of the environments in the mask (N,)."""
    infos: dict[str, Any] = {}
    partial = not mask.all()
    for key in INFO_KEYS:
        value = reports[key].astype(bool) if key in _FLAGS else reports[key].copy()
        if partial:
            value[~mask] = 0
        infos[key], infos[f"_{key}"] = value, mask.copy()
    by_name = dict(zip(COSTS, infos["costs"].T.copy(), strict=True))
    infos["costs"] = by_name | {f"_{name}": mask.copy() for name in COSTS}  # as Gymnasium nests them
    return infos


def option_templates(p: Problem, options: Mapping[str, Any]) -> EpisodeTemplates:
    """Templates of one episode with other settings.

    Raises:
        ValueError: an option is unknown or not valid, the satellite has another number of wheels, or something has
            products of inertia that the filter leaves out.
    """
    if not isinstance(options, Mapping):
        raise ValueError(f"reset options must be a mapping, got {options!r}")
    for name in options:
        if name not in RESET_OPTIONS:
            raise unknown_name("reset option", name, RESET_OPTIONS)
    given = "satellite" in options
    satellites = p.scenario.equip(resolve_satellites(options["satellite"])) if given else p.satellites
    for count in (satellite.wheels.count for satellite in satellites):
        if count != p.wheels:
            raise ValueError(f"the satellite for this episode must have {p.wheels} wheels, got {count}")
    for own in (oscillator_counts(satellite.oscillators) for satellite in satellites):
        if own != oscillator_counts(p.satellites[0].oscillators):
            raise ValueError(
                f"the satellite for this episode must have as many oscillators as the environment's, and as many of "
                f"them mirrored: it has {len(own)} and {sum(own)} in all"
            )
    sheet, *others = map(p.scenario.operate, (p.satellites[0], *satellites))
    for other in others:
        if p.filter_needs(other) != p.filter_needs(sheet):
            raise ValueError(
                "the satellite for this episode must have tolerances of the same kinds and sensors like the "
                "environment's, whose filter has states for them: give scenario tolerances and sensors, which replace "
                "the satellite's"
            )
    changed = p.replace(satellites=satellites, inertia=resolve_inertia(options.get("inertia", p.inertia)))
    room = p.inertia.room if isinstance(p.inertia, InertiaLaw) else 1
    if isinstance(changed.inertia, InertiaLaw) and changed.inertia.room > room:
        raise ValueError(
            f"the environment has no room for the {changed.inertia.label}'s knots: make it with a table of as many, "
            "inertia=law"
        )
    return build_templates(changed, options.get("true_inertia"), room)
