"""What the single and the vector environment share: spaces, keys of info, reset options, what passes for an action."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from satid_gym.config import unknown_name
from satid_gym.core.observation import BOUND
from satid_gym.laws import InertiaLaw
from satid_gym.problem import Problem, Templates, build_templates, resolve_inertia, resolve_satellites

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
    "cost",
    "effort",
    "saturated",
    "torque_applied",
    "guarded",
    "rejected",
    "faults",
)
FLAGS = ("saturated", "faults")  # keys whose values are arrays of bool


def make_spaces(p: Problem) -> tuple[spaces.Box, spaces.Box]:
    """Observation and action space of one environment."""
    size = max(place.stop for place in p.layout.values())
    return (
        spaces.Box(-BOUND, BOUND, (size,), np.float32),
        spaces.Box(-1.0, 1.0, (p.wheels,), np.float32),
    )


def seed_stream(rng: np.random.Generator) -> np.ndarray:
    """First state (4,) of an environment's random stream, from its generator."""
    return rng.integers(1, 2**64, size=4, dtype=np.uint64)


def real_action(name: str, value: object) -> np.ndarray:
    """What an agent chose as float32; what overflows is infinite.

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
        return array.astype(np.float32, order="C")  # always a copy: numba compiles anew for read-only or strided ones


def option_templates(p: Problem, options: Mapping[str, Any]) -> Templates:
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
    satellites = resolve_satellites(options.get("satellite", p.satellites))
    for count in (satellite.wheels.count for satellite in satellites):
        if count != p.wheels:
            raise ValueError(f"the satellite for this episode must have {p.wheels} wheels, got {count}")
    changed = p.replace(satellites=satellites, inertia=resolve_inertia(options.get("inertia", p.inertia)))
    room = p.inertia.room if isinstance(p.inertia, InertiaLaw) else 1
    if isinstance(changed.inertia, InertiaLaw) and changed.inertia.room > room:
        raise ValueError(
            f"the environment has no room for the {changed.inertia.label}'s knots: make it with a table of as many, "
            "inertia=law"
        )
    return build_templates(changed, options.get("true_inertia"), room)


DRAW_FAILED = (
    "no physical inertia tensor in 1000 draws: the nominal tensor is too close to the "
    "triangle inequality for this inertia_std, tilt_std or law; lower them or change the satellite"
)
BROKEN = (
    "the filter broke down: its covariance is no longer positive definite, or its estimate not finite; "
    "sample more often, give sensors some noise, or check the estimator's settings"
)
