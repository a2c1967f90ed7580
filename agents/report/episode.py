"""One episode of the comparison in full: the learned policy beside the best scripted one of the paper's eight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.report.curves import rounded
from agents.tables import inside
from baselines.recording import Recording, record
from satid_gym.laws import InertiaLaw
from satid_gym.policy import Policy
from satid_gym.problem import resolve_satellites
from satid_gym.profiles import PROFILES
from satid_gym.rendering.scene import box
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.selection import label

Record = Mapping[str, Any]

_CELL = ("microsat", "step")  # flown where the comparison has it: middle of the three, and the law with an event
_INTERVAL = 0.5  # s between two instants that are kept


def episode_cell(satellites: Sequence[str], modes: Sequence[str]) -> tuple[str, str]:
    """Names of the satellite and of the inertia mode whose first seed is shown."""
    satellite, mode = _CELL
    return satellite if satellite in satellites else satellites[0], mode if mode in modes else modes[0]


def protagonists(records: Sequence[Record]) -> list[str]:
    """Names of the policies to show, of the records of one cell: the best scripted, and the best learned.

    Who does not keep to the envelope is best only where no other of its kind does. Where no learned policy flew, the
    best closed loop stands in for it. Where only one of the two sides flew, it is shown alone; where neither did, the
    best of all is.
    """
    kinds = {kind: [r for r in records if r["kind"] == kind] for kind in ("learned", "closed_loop")}
    scripted = [r for r in records if r["policy"] in PROFILES]
    groups = [group for group in (scripted, kinds["learned"] or kinds["closed_loop"]) if group] or [[*records]]
    return [min(inside(group), key=lambda r: r["final_error_mean"])["policy"] for group in groups]


def fly_episode(
    policies: Sequence[Policy], *, satellite: str | Satellite, mode: str | InertiaLaw, seed: int, scenario: Scenario
) -> dict[str, Any]:
    """Fly the episode of a seed with each policy; plain values, SI units, body frame unless said otherwise.

    Returns:
        Limits, size and wheels of the satellite, and `flights`: of each policy, series of `time` (T,), `error` (T,),
        `inertia`, `estimate` and `sigma` (3, T) of the moments, `rate` (3, T), `wheel_speed` (n, T), `momentum`
        (3, T) and `attitude` (4, T), body to inertial, scalar last. A flight ends with its termination.
    """
    (nominal,) = resolve_satellites(satellite)
    operated = scenario.operate(nominal)
    size = box(operated)[0] if operated.size is None else operated.size
    flights: list[dict[str, Any]] = []
    for policy in policies:
        recording = record(policy, satellite=satellite, inertia=mode, seeds=[seed], scenario=scenario)
        ends = scenario.termination_factor * operated.rate_limit
        flights.append({"policy": policy.name, "kind": policy.kind, **_series(recording, ends)})
    return {
        "satellite": operated.name,
        "inertia_mode": label(mode),
        "seed": seed,
        "horizon": scenario.horizon,
        "size": size.tolist(),
        "rate_limit": operated.rate_limit,
        "wheel_axes": operated.wheels.axes.T.tolist(),
        "wheel_speed_limit": operated.wheels.max_speed.tolist(),
        "flights": flights,
    }


def _series(recording: Recording, termination_rate: float) -> dict[str, Any]:
    course = recording.course
    over = np.flatnonzero(np.abs(course.rate[0]).max(axis=1) > termination_rate)
    end = int(over[0]) + 1 if len(over) else len(course.rate[0])
    kept = slice(0, end, max(1, round(_INTERVAL / recording.dt)))
    estimate, truth = np.zeros_like(course.inertia[0, kept]), course.inertia[0, kept]
    moments = np.arange(3)
    estimate[:, moments, moments] = recording.theta[0, kept]  # benchmark scenarios estimate principal moments
    error = np.linalg.norm(estimate - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))
    sigma = np.sqrt(np.diagonal(recording.covariance[0, kept], axis1=1, axis2=2))
    return {
        "time": rounded(recording.dt * np.arange(end)[kept], 6),
        "error": rounded(error, 4),
        "inertia": _rows(truth[:, moments, moments], 6),
        "estimate": _rows(recording.theta[0, kept], 6),
        "sigma": _rows(sigma),
        "rate": _rows(course.rate[0, kept], 4),
        "wheel_speed": _rows(course.wheel_speed[0, kept], 4),
        "momentum": _rows(course.momentum[0, kept], 4),
        "attitude": _rows(recording.attitude[0, kept], 5),
    }


def _rows(series: np.ndarray, digits: int = 3) -> list[list[float]]:
    """A series (T, k) as k lists of T numbers."""
    return [rounded(column, digits) for column in series.T]
