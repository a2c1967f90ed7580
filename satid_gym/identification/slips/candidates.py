"""Slips of units, signs, axes and quaternions: what each is called, how to mend it, and how a log is without it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from satid_gym.satellite import Satellite
from satid_gym.telemetry.columns import HOW
from satid_gym.telemetry.log import Log
from satid_gym.telemetry.units import DEGREE, RPM, option_of, turned_unit, unit_of

_REORDER = f"name the columns in this order, as in {HOW}"


@dataclass(frozen=True, eq=False)
class Slip:
    """A slip, its remedy in words, and the log without it."""

    name: str
    remedy: str
    undo: Callable[[Log], Log]


def slips_of(logs: Sequence[Log], satellite: Satellite) -> Iterator[Slip]:
    """Slips that are possible: units are stated or not, and a gyro that an attitude agrees with is right."""
    first, wheels = logs[0], satellite.wheels.count
    gyro_is_right = all(log.attitude is not None for log in logs)
    if not gyro_is_right:
        yield from rate_slips(logs[0])
    for name, factor, unit in (
        ("wheel speeds in rpm that were read as rad/s", RPM, "rpm"),
        ("wheel speeds in rad/s that were read as rpm", 1.0 / RPM, "rad/s"),
        ("all wheel speeds with the opposite sign", -1.0, turned_unit(first.units, "wheel_speed")),
        ("wheel speeds in rpm with the opposite sign that were read as rad/s", -RPM, "-rpm"),
    ):
        if factor == -1.0 or _may_be(first, "wheel_speed", name):
            yield Slip(
                name, f"give {option_of({'wheel_speed': unit})}", _scaled("wheel_speed", np.full(wheels, factor))
            )
    if not gyro_is_right and _may_be(first, "rate", "rad/s") and _may_be(first, "wheel_speed", "rad/s"):
        both = _scaled("rate", np.full(3, DEGREE)), _scaled("wheel_speed", np.full(wheels, RPM))
        yield Slip(
            "gyro rates in deg/s and wheel speeds in rpm, both read as rad/s",
            f"give {option_of({'rate': 'deg/s', 'wheel_speed': 'rpm'})}",
            lambda log: both[0](both[1](log)),
        )
    axes = satellite.wheels.axes
    for k in range(3):
        mirrored = np.linalg.pinv(axes) @ (axes * np.where(np.arange(3) == k, -1.0, 1.0)[:, None])
        yield Slip(
            f"row {'xyz'[k]} of the wheels' axes with the opposite sign",
            "negate it in the satellite's data sheet",
            _turned("wheel_speed", mirrored),
        )
    for k in range(wheels):
        signs = np.where(np.arange(wheels) == k, -1.0, 1.0)
        yield Slip(
            f"wheel {k + 1} with the opposite sign",
            f"negate column {k + 1} of wheel_speed in the file, or its axis in the satellite's",
            _scaled("wheel_speed", signs),
        )
    orders = list(itertools.permutations(range(wheels)))[1:] if wheels <= 4 else list(_exchanges(wheels))
    for order in orders:
        names = ", ".join(str(k + 1) for k in order)
        yield Slip(f"wheels in the order {names}", _REORDER, _ordered("wheel_speed", order))


def _exchanges(count: int) -> Iterator[tuple[int, ...]]:
    for i, j in itertools.combinations(range(count), 2):
        order = list(range(count))
        order[i], order[j] = j, i
        yield tuple(order)


def rate_slips(log: Log, *, proven: bool = False) -> Iterator[Slip]:
    """Slips of the gyro; `proven`: where an attitude proves the unit that a file states wrong."""
    for name, factor, unit in (
        ("gyro rates in deg/s that were read as rad/s", DEGREE, "deg/s"),
        ("gyro rates in mrad/s that were read as rad/s", 1e-3, "mrad/s"),
        ("gyro rates in rad/s that were read as deg/s", 1.0 / DEGREE, "rad/s"),
        ("gyro rates with the opposite sign", -1.0, turned_unit(log.units, "rate")),
    ):
        if factor == -1.0 or proven or _may_be(log, "rate", name):
            yield Slip(name, f"give {option_of({'rate': unit})}", _scaled("rate", np.full(3, factor)))
    for order in list(itertools.permutations(range(3)))[1:]:
        names = ", ".join("xyz"[k] for k in order)
        yield Slip(f"gyro axes in the order {names}", _REORDER, _ordered("rate", order))
    for k in range(3):
        signs = np.where(np.arange(3) == k, -1.0, 1.0)
        remedy = f"negate column {k + 1} of rate in the file"
        yield Slip(f"gyro axis {'xyz'[k]} with the opposite sign", remedy, _scaled("rate", signs))


def attitude_slips() -> Iterator[Slip]:
    """Slips of the quaternion's order and direction."""
    first = "a quaternion that is scalar first and was read as scalar last"
    last = "a quaternion that is scalar last and was read as scalar first"
    inverse = "a quaternion from inertial to body that was read as body to inertial"
    conjugate = np.array([-1.0, -1.0, -1.0, 1.0])
    negate = "negate these columns in the file: those of its vector part"
    yield Slip(first, f"give {option_of({'attitude': 'scalar first'})}", _rolled(-1, np.ones(4)))
    yield Slip(last, f"give {option_of({'attitude': 'scalar last'})}", _rolled(1, np.ones(4)))
    yield Slip(inverse, negate, _rolled(0, conjugate))
    both = f"give {option_of({'attitude': 'scalar first'})}, and {negate}"
    yield Slip(f"{first}, and {inverse[2:]}", both, _rolled(-1, conjugate))


def _may_be(log: Log, role: str, name: str) -> bool:
    """Whether a slip of units, whose name ends with the unit that was taken, is possible: no file states another."""
    taken = unit_of(log.units.get(role, "").removeprefix("-"))
    return taken is None or (role not in log.stated and name.endswith(taken))


def _scaled(role: str, factors: np.ndarray) -> Callable[[Log], Log]:
    return lambda log: replace(log, **{role: getattr(log, role) * factors})


def _turned(role: str, matrix: np.ndarray) -> Callable[[Log], Log]:
    return lambda log: replace(log, **{role: getattr(log, role) @ matrix.T})


def _ordered(role: str, order: Sequence[int]) -> Callable[[Log], Log]:
    return lambda log: replace(log, **{role: getattr(log, role)[:, list(order)]})


def _rolled(places: int, signs: np.ndarray) -> Callable[[Log], Log]:
    return lambda log: replace(log, attitude=np.roll(np.asarray(log.attitude), places, axis=1) * signs)
