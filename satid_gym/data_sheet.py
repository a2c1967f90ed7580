"""Data sheet of a satellite, looked over before it is believed: what follows from it, what it leaves out, and doubts.

A value in another unit is often possible, and then every result is wrong by a factor that nothing shows. The doubts
compare the numbers of a satellite with each other. Their limits are wide: an unusual satellite passes, most slips of a
unit do not.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields

import numpy as np

from satid_gym.satellite import Satellite
from satid_gym.tolerances import Tolerances

_UNITS = {
    "mass": "kg",
    "size": "m",
    "rate_limit": "rad/s",
    "gyro_noise_std": "rad/s",
    "tachometer_noise_std": "rad/s",
    "disturbance_std": "N m",
}
_BOX = 10.0  # moment over that of a uniform box, or its inverse
_TO_LIMIT = (0.05, 1800.0)  # s, from rest to the rate limit
_SPIN_UP = (0.5, 10_000.0)  # s, of a wheel to its speed limit
_SPEED = 2000.0  # rad/s, 19 000 rpm
_ROTOR = (1e-7, 0.3)  # rotor inertia over the smallest moment
_RATE = 1.0  # rad/s
_NOISE = 0.05  # of the gyro over the rate limit
_BIAS = 0.1  # likewise
_DISTURBANCE = 0.1  # over the torque of the wheels


@dataclass(frozen=True, eq=False)
class Derived:
    """What follows from a data sheet, about each body axis.

    Attributes:
        moment: (3,) diagonal of the inertia, kg m^2.
        torque: (3,) of all wheels together, N m.
        to_limit: (3,) s from rest to the rate limit at that torque.
        reached: (3,) rad/s at which the body turns once the wheels, from rest, are at their speed limit.
        box: (3,) moment over that of a uniform box of the same mass and size; None where these are not given.
        spin_up: (n,) s of each wheel from rest to its speed limit.
    """

    moment: np.ndarray
    torque: np.ndarray
    to_limit: np.ndarray
    reached: np.ndarray
    box: np.ndarray | None
    spin_up: np.ndarray


def derived(satellite: Satellite) -> Derived:
    """What follows from a data sheet."""
    wheels, moment = satellite.wheels, np.diag(satellite.inertia)
    box = None
    if satellite.mass is not None and satellite.size is not None:
        square = satellite.size**2
        box = 12.0 * moment / (satellite.mass * (square.sum() - square))
    return Derived(
        moment=moment,
        torque=wheels.torque_reach,
        to_limit=satellite.rate_limit * moment / wheels.torque_reach,
        reached=wheels.momentum_reach / moment,
        box=box,
        spin_up=wheels.max_momentum / wheels.max_torque,
    )


def left_out(satellite: Satellite) -> list[str]:
    """What the data sheet does not say, or says as the default has it, and what is assumed, one line each."""
    defaults = {field.name: field.default for field in fields(Satellite) if field.default is not MISSING}
    void = {"tachometer_noise_std"} if satellite.sensors.counts else set()
    same = [name for name in _UNITS if _is(getattr(satellite, name), defaults[name]) and name not in void]
    lines = [f"{name}: {_shown(satellite, name)}" for name in same]
    sensors, tolerances = satellite.sensors, satellite.tolerances
    exact = [field.name for field in fields(Tolerances) if getattr(tolerances, field.name) == 0.0]
    if sensors.tachometer_delay == 0.0:
        exact.remove("tachometer_delay")
    if exact:
        lines.append(f"tolerances: taken as exactly nominal: {', '.join(exact)}")
    if not sensors.are_timed:
        lines.append("sensors: readings are taken as of the instant at which they are given")
    if sensors.star_tracker is None:
        lines.append("sensors.star_tracker: none")
    if not satellite.oscillators:
        lines.append("oscillators: the body is taken as rigid")
    return lines


def _is(value: object, default: object) -> bool:
    return value is None if default is None else isinstance(value, float) and value == default


def _shown(satellite: Satellite, name: str) -> str:
    value = getattr(satellite, name)
    return "not given" if value is None else f"{value:g} {_UNITS[name]}, the default"


def doubts(satellite: Satellite) -> list[str]:
    """What is hard to believe of a data sheet, and which unit may be meant, one line each; empty where nothing is."""
    own, wheels, limit = derived(satellite), satellite.wheels, satellite.rate_limit
    axes, each = "xyz", range(1, satellite.wheels.count + 1)
    found = []
    if own.box is not None and (odd := _beyond(axes, own.box, (1.0 / _BOX, _BOX))):
        found.append(
            f"the moment about {odd} times that of a uniform box of this mass and size: is the inertia in kg m^2, the "
            "mass in kg, the size in m?"
        )
    if odd := _beyond(axes, own.to_limit, _TO_LIMIT):
        found.append(
            f"the time from rest to the rate limit about {odd} s: is the inertia in kg m^2, the torque in N m, the "
            "rate limit in rad/s?"
        )
    if odd := _beyond(axes, own.reached, (limit, np.inf)):
        found.append(
            f"the rate that wheels at their speed limit give about {odd} rad/s, less than the rate limit of {limit:g}: "
            "is the rotors' inertia in kg m^2, their speed limit in rad/s?"
        )
    if odd := _beyond(each, own.spin_up, _SPIN_UP):
        found.append(f"the time to the speed limit of wheel {odd} s: is its inertia in kg m^2, its torque in N m?")
    if odd := _beyond(each, wheels.max_speed, (0.0, _SPEED)):
        found.append(f"the speed limit of wheel {odd} rad/s: is it in rpm?")
    if odd := _beyond(each, wheels.inertia / own.moment.min(), _ROTOR):
        found.append(f"the rotor's inertia of wheel {odd} of the body's least moment: are both in kg m^2?")
    if limit > _RATE:
        found.append(f"the rate limit is {limit:.3g} rad/s: is it in deg/s?")
    if satellite.gyro_noise_std > _NOISE * limit:
        found.append(
            f"the gyro's noise of a sample, {satellite.gyro_noise_std:g} rad/s, is more than a twentieth of "
            "the rate limit: is it in deg/s?"
        )
    if satellite.tolerances.gyro_bias > _BIAS * limit:
        found.append(
            f"the tolerance of the gyro's bias, {satellite.tolerances.gyro_bias:g} rad/s, is more than a tenth of the "
            "rate limit: is it in deg/s or deg/h? If it is right, calibrate the gyro at rest first"
        )
    if satellite.disturbance_std > _DISTURBANCE * own.torque.min():
        found.append(
            f"the disturbance, {satellite.disturbance_std:g} N m, is more than a tenth of the wheels' torque: is it in "
            "N m?"
        )
    sensors = satellite.sensors
    for name, other in (("gyro_noise_std", sensors.gyro_quantum > 0.0), ("tachometer_noise_std", sensors.counts)):
        if getattr(satellite, name) == 0.0 and not other:
            found.append(f"{name} is 0: no sensor is free of noise, and the filter believes that this one is")
    return found


def _beyond(names: Iterable[object], values: np.ndarray, limits: tuple[float, float]) -> str:
    """Names of the values beyond the limits, and how large these are, as "x, z is 2 to 3"; empty where none is."""
    low, high = limits
    odd = {str(name): value for name, value in zip(names, values, strict=True) if not low <= value <= high}
    if not odd:
        return ""
    ends = dict.fromkeys(f"{end(odd.values()):.3g}" for end in (min, max))
    return f"{', '.join(odd)} is {' to '.join(ends)}"
