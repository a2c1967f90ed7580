"""Readings as they arrive: missing, refused or good."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from satid_gym.config import check_number, direction
from satid_gym.satellite import Satellite

SPEED_MAX, RATE_MAX = 1.5, 10.0  # a reading beyond this many limits is a wrong unit or a fault
_LENGTH_SLACK = 1e-3  # of a quaternion


class Reading(NamedTuple):
    """A reading, or None with the kind of its absence ("missing" or "refused") and what was wrong, in words."""

    value: np.ndarray | None
    absence: str = ""
    message: str = ""


def instant(time: object) -> float:
    """Time stamp, s, of any clock.

    Raises:
        ValueError: it is not a finite number.
    """
    if isinstance(time, (float, np.floating)) and not np.isfinite(time):
        raise ValueError(f"time must be finite, got {time!r}: give the stamp of the readings, s, of any clock")
    return check_number("time", time, low=-np.inf)


def gyro_reading(value: object, satellite: Satellite) -> Reading:
    """Reading of the gyro, (3,) rad/s.

    Raises:
        ValueError: it has another shape.
    """
    limit = satellite.rate_limit
    return _reading("gyro", value, np.full(3, RATE_MAX * limit), f"rad/s where the rate limit is {limit:g}", "in deg/s")


def wheel_reading(value: object, satellite: Satellite) -> Reading:
    """Reading of the wheel speeds, (n,) rad/s.

    Raises:
        ValueError: it has another shape.
    """
    limit = satellite.wheels.max_speed
    return _reading("wheel speed", value, SPEED_MAX * limit, f"rad/s where the limit is {limit.max():g}", "in rpm")


def attitude_reading(value: object, satellite: Satellite) -> Reading:
    """Reading of the star tracker, (4,) of length 1, body to inertial, scalar last; a missing one is no fault.

    Raises:
        ValueError: it has another shape, or the satellite has no star tracker.
    """
    if value is not None and satellite.sensors.star_tracker is None:
        raise ValueError(
            f"{satellite.name} has no star tracker to read an attitude: leave it out, or give sensors with star_tracker"
        )
    reading = _reading("attitude", value, np.full(4, 1.0 + _LENGTH_SLACK), "in a quaternion of length 1", "in degrees")
    if reading.absence == "missing":
        return Reading(None)
    if reading.value is not None and abs(np.linalg.norm(reading.value) - 1.0) > _LENGTH_SLACK:
        length = np.linalg.norm(reading.value)
        return Reading(None, "refused", f"attitude is no quaternion of length 1, but of {length:.4g}")
    return reading


def sun_direction(value: object) -> np.ndarray:
    """Direction of the Sun as a unit vector (3,).

    Raises:
        ValueError: it is no direction.
    """
    return direction("sun", value)


def _reading(name: str, value: object, limit: np.ndarray, compared: str, unit: str) -> Reading:
    if value is None:
        return Reading(None, "missing", f"no {name}")
    array = np.asarray(value, dtype=float)
    if array.shape != limit.shape:
        raise ValueError(f"{name} must have shape {limit.shape}, got {array.shape}")
    if np.isnan(array).all():
        return Reading(None, "missing", f"no {name}")
    if not np.isfinite(array).all():
        return Reading(None, "refused", f"{name} is not finite: {array.tolist()}")
    if (np.abs(array) > limit).any():
        return Reading(None, "refused", f"{name} reads {np.abs(array).max():.4g} {compared}: is it {unit}?")
    return Reading(array)
