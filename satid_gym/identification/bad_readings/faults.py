"""Faults of tachometers: readings of one wheel that no motion explains, found by a fit and left out of the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from satid_gym.identification.estimate import Estimated
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.telemetry import Log

_TIMES = 30.0  # the robust size of the residuals
_ALONE = 3.0  # times as large as what that wheel alone leaves unexplained
_NAMED = 3  # faults of a wheel in a flight, up to which each has a line of its own
_CLOCK = 1e8  # s: stamps beyond it are seconds since 1970


@dataclass(frozen=True, kw_only=True)
class TachometerFault:
    """A reading of wheel `wheel` (from 1) of flight `flight` at stamp `time`, s, that is `excess` rad/s too high."""

    flight: int
    time: float
    wheel: int
    excess: float

    def __str__(self) -> str:
        when = f"{self.time:.6g} s" if abs(self.time) < _CLOCK else f"{datetime.fromtimestamp(self.time, UTC):%F %T}"
        found = f"wheel {self.wheel} reads {self.excess:+.3g} rad/s off at {when}"
        return f"{found}: a tachometer fault or a stale reading, left out"


def wheel_residuals(residual: np.ndarray, wheels: ReactionWheels) -> np.ndarray:
    """Residuals (N, 3) of the momentum, N m s, as wheel speeds (N, n): measured less balanced, rad/s."""
    return -residual @ np.linalg.pinv(wheels.axes * wheels.inertia).T


def tachometer_faults(estimated: Estimated, wheels: ReactionWheels) -> list[TachometerFault]:
    """Readings of a single wheel that are off by thirty times the residuals' size."""
    spin = wheels.axes * wheels.inertia
    length = np.linalg.norm(spin, axis=0)
    rows = [-residual @ spin / length**2 for residual in estimated.fit.residuals]  # if that wheel alone is wrong
    size = 1.4826 * np.median(np.abs(np.concatenate(rows)), axis=0).max()  # of the noisiest wheel, over all flights
    found = []
    for window, residual, excesses in zip(estimated.windows, estimated.fit.residuals, rows, strict=True):
        for time, whole, excess in zip(window.time, residual, excesses, strict=True):
            worst = int(np.argmax(np.abs(excess) * length))
            rest = float(np.linalg.norm(whole + spin[:, worst] * excess[worst])) / length[worst]
            if abs(excess[worst]) > max(_TIMES * size, _ALONE * rest):
                fault = TachometerFault(
                    flight=window.flight, time=float(time), wheel=worst + 1, excess=float(excess[worst])
                )
                found.append(fault)
    return found


def without_faults(logs: Sequence[Log], faults: Sequence[TachometerFault]) -> list[Log]:
    """Logs in which the faulty readings are missing."""
    found = []
    for number, log in enumerate(logs):
        speed = log.wheel_speed.copy()
        for fault in faults:
            if fault.flight == number:
                speed[log.time == fault.time, fault.wheel - 1] = np.nan
        found.append(replace(log, wheel_speed=speed))
    return found


def fault_notes(logs: Sequence[Log], faults: Sequence[TachometerFault]) -> list[str]:
    """A line for each fault; of many of one wheel in one flight there is one line."""
    found = []
    for flight, wheel in sorted({(fault.flight, fault.wheel) for fault in faults}):
        mine = [fault for fault in faults if (fault.flight, fault.wheel) == (flight, wheel)]
        if len(mine) <= _NAMED:
            found += [f"{logs[flight].name}: {fault}" for fault in mine]
        else:
            worst = max((fault.excess for fault in mine), key=abs)
            found.append(
                f"{logs[flight].name}: wheel {wheel} reads up to {worst:+.3g} rad/s off in {len(mine)} readings: "
                "tachometer faults or stale readings, left out"
            )
    return found
