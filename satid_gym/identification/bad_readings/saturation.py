"""Saturation: readings of a gyro at the end of its range, which say only that the rate was beyond it.

A data sheet may name the range. Else readings tell it: a gyro whose noise shows hardly ever reads the same twice in a
row, but at the end of its range always does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from satid_gym.satellite import Satellite
from satid_gym.telemetry.log import REPEATS_MAX, Log

_NEAR = 1e-3  # of the range that is told
_CHANCE_MAX = 1e-9  # of as many equal ones in a row at the largest reading


def without_saturated(logs: Sequence[Log], satellite: Satellite) -> list[Log]:
    """Logs without readings of the gyro at the end of its range, with a note of how many in which axis."""
    cleaned = []
    for log in logs:
        saturated = _saturated(log.rate, satellite.sensors.gyro_range)
        notes = tuple(
            f"{int(saturated[:, k].sum())} readings of gyro {axis} left out: they are at the end of its range, "
            f"{np.abs(log.rate[saturated[:, k], k]).min():.3g} rad/s"
            for k, axis in enumerate("xyz")
            if saturated[:, k].any()
        )
        rate = np.where(saturated, np.nan, log.rate)
        cleaned.append(replace(log, rate=rate, notes=(*log.notes, *notes)) if notes else log)
    return cleaned


def _saturated(rate: np.ndarray, told: float | None) -> np.ndarray:
    """(N, 3) whether readings of the gyro are at the end of the range that is told, or that they tell."""
    found = np.zeros(rate.shape, bool)
    if told is not None and not (np.abs(rate) > (1.0 + _NEAR) * told).any():  # else it is another gyro, or another unit
        return np.asarray(np.abs(rate) >= (1.0 - _NEAR) * told)
    for k in range(rate.shape[1]):
        there = np.flatnonzero(np.isfinite(rate[:, k]))
        found[there, k] = _at_an_end(rate[there, k])
    return found


def _at_an_end(value: np.ndarray) -> np.ndarray:
    """(N,) whether readings of one axis are at an end of its range; none where that may be chance."""
    found = np.zeros(len(value), bool)
    if len(value) == 0 or np.ptp(value) == 0.0:
        return found
    ends = [value == end for end, side in ((value.max(), 1.0), (value.min(), -1.0)) if side * end > 0.0]
    inside = ~np.logical_or.reduce([found, *ends])
    equal = value[1:] == value[:-1]
    usual = (np.sum(equal & inside[1:]) + 1.0) / (np.sum(inside[1:]) + 2.0)  # by Laplace's rule of succession
    for at_end in ends:
        if usual < REPEATS_MAX and usual ** int(np.sum(equal & at_end[1:])) < _CHANCE_MAX:
            found |= at_end
    return found
