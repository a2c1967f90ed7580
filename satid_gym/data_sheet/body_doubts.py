"""Doubts about a data sheet.

A value in another unit is often possible, and then every result is wrong by a factor that nothing shows. The doubts
compare the numbers of a satellite with each other. Their limits are wide: an unusual satellite passes, most slips of a
unit do not.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from satid_gym.data_sheet.appendage_doubts import oscillator_doubts, tracker_doubts
from satid_gym.data_sheet.consequences import derived
from satid_gym.satellite import Satellite

_BOX = 10.0  # moment over that of a uniform box, or its inverse
_TO_LIMIT = (0.05, 1800.0)  # s, from rest to the rate limit
_SPIN_UP = (0.5, 10_000.0)  # s, of a wheel to its speed limit
_SPEED = 2000.0  # rad/s, 19 000 rpm
_ROTOR = (1e-7, 0.3)  # rotor inertia over the smallest moment
_RATE = 1.0  # rad/s
_NOISE = 0.05  # of the gyro over the rate limit
_BIAS = 0.1  # likewise
_DISTURBANCE = 0.1  # over the torque of the wheels


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
    for number, oscillator in enumerate(satellite.oscillators, 1):
        found += [f"oscillator {number}: {doubt}" for doubt in oscillator_doubts(oscillator, satellite)]
    if sensors.star_tracker is not None:
        found += [f"star tracker: {doubt}" for doubt in tracker_doubts(sensors.star_tracker)]
    return found


def _beyond(names: Iterable[object], values: np.ndarray, limits: tuple[float, float]) -> str:
    """Names of the values beyond the limits, and how large these are, as "x, z is 2 to 3"; empty where none is."""
    low, high = limits
    odd = {str(name): value for name, value in zip(names, values, strict=True) if not low <= value <= high}
    if not odd:
        return ""
    ends = dict.fromkeys(f"{end(odd.values()):.3g}" for end in (min, max))
    return f"{', '.join(odd)} is {' to '.join(ends)}"
