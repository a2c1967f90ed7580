"""Spikes: readings far from those before and after them, such as 99999 for a lost reading.

They go before a fit, which cannot weigh them out, because the wheels' speeds run on splines through them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from satid_gym.identification.bad_readings.faults import TachometerFault
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_ROWS_MAX = 3  # of a spike
_TIMES = 30.0  # the robust size of what readings differ by from the line between their neighbours
_OVER = 10.0  # what the neighbours of the spike differ by
_MOTORS = 3.0  # what the motors can change between two readings
_FAR = 10.0  # the range of nearly all readings
_NEARLY_ALL = (0.05, 0.95)


def without_spikes(logs: Sequence[Log], satellite: Satellite) -> tuple[list[Log], list[TachometerFault]]:
    """Logs without readings that are spikes, with a note of the gyro's, and those of tachometers one by one.

    A spike is up to three rows of one column that leave the line between the rows before and after them, which agree,
    by thirty times the usual and three times what the motors could do. Where gyro and wheels do so in the same row, the
    satellite may have moved, and it takes ten times the range of nearly all readings.
    """
    cleaned, faults = [], []
    for number, log in enumerate(logs):
        rate, speed = _spikes_of(log, satellite)
        notes: tuple[str, ...] = ()
        if count := int(np.isfinite(rate).sum()):
            largest = float(np.abs(log.rate[np.isfinite(rate)]).max())
            notes = (f"{count} spikes of the gyro left out, the largest of {largest:.3g} rad/s",)
        faults += [
            TachometerFault(flight=number, time=float(log.time[i]), wheel=int(k) + 1, excess=float(speed[i, k]))
            for i, k in np.argwhere(np.isfinite(speed))
        ]
        if notes or np.isfinite(speed).any():
            log = replace(
                log,
                rate=np.where(np.isfinite(rate), np.nan, log.rate),
                wheel_speed=np.where(np.isfinite(speed), np.nan, log.wheel_speed),
                notes=(*log.notes, *notes),
            )
        cleaned.append(log)
    return cleaned, faults


def _spikes_of(log: Log, satellite: Satellite) -> tuple[np.ndarray, np.ndarray]:
    """How far spikes of rate (N, 3) and wheel speeds (N, n) are off, rad/s; NaN elsewhere."""
    wheels = satellite.wheels
    torque = float(wheels.torque_reach.max())
    turned = torque / float(np.diag(satellite.inertia).min())  # rad/s^2, at the most
    spun = float((wheels.max_torque / wheels.inertia).max())
    rate = _off(log.time, log.rate, _MOTORS * log.interval * turned)
    speed = _off(log.time, log.wheel_speed, _MOTORS * log.interval * spun)
    moved = np.isfinite(rate).any(axis=1) & np.isfinite(speed).any(axis=1)
    for off, values in ((rate, log.rate), (speed, log.wheel_speed)):
        off[moved[:, None] & ~(np.abs(off) > _FAR * _range(values))] = np.nan
    return rate, speed


def _off(time: np.ndarray, values: np.ndarray, reach: float) -> np.ndarray:
    """(N, n) of values how far spikes are off, more than `reach`; NaN elsewhere."""
    found = np.full(values.shape, np.nan)
    for k in range(values.shape[1]):
        there = np.flatnonzero(np.isfinite(values[:, k]))
        for rows, off in _groups(time[there], values[there, k], reach):
            found[there[rows], k] = off
    return found


def _groups(time: np.ndarray, value: np.ndarray, reach: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows of each spike of one column, (N,) readings that are all there, and how far they are off."""
    if len(value) < 3:
        return
    size = max(reach, _TIMES * 1.4826 * float(np.median(np.abs(_off_line(time, value, 1)))))
    for width in range(1, min(_ROWS_MAX, len(value) - 2) + 1):
        off = _off_line(time, value, width)
        step = np.abs(value[width + 1 :] - value[: -width - 1])
        for first in np.flatnonzero((np.abs(off) > np.maximum(size, _OVER * step)[:, None]).all(axis=1)):
            yield first + 1 + np.arange(width), off[first]


def _off_line(time: np.ndarray, value: np.ndarray, width: int) -> np.ndarray:
    """(N - width - 1, width) of `width` readings in a row: off the line between the readings before and after them."""
    inside = np.arange(len(value) - width - 1)[:, None] + np.arange(1, width + 1)
    before, after = inside[:, :1] - 1, inside[:, -1:] + 1
    share = (time[inside] - time[before]) / (time[after] - time[before])
    return np.asarray(value[inside] - (1.0 - share) * value[before] - share * value[after])


def _range(values: np.ndarray) -> np.ndarray:
    """(n,) of nearly all readings of each column."""
    found = np.zeros(values.shape[1])
    there = np.isfinite(values).any(axis=0)
    if there.any():
        low, high = np.nanquantile(values[:, there], _NEARLY_ALL, axis=0)
        found[there] = high - low
    return found
