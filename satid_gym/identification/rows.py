"""Rows of the momentum balance, window by window, from logs.

With C the attitude (body to inertial), a = A j Omega and J omega = L(omega) theta, the momentum of a window of some
tens of seconds is that of a constant external torque:

    L(omega) theta + a - J g + C^T (p x D g) - C^T D b + d_w da/dt + d_a omega x h = C^T (H + tau (t - t_mean) + K)

with h = J omega + a, D the integral of C dt, and K that of C times the torque on the body that is known, where the log
has it. What differs from window to window is H and a torque tau in inertial space; a flight has in common g, the
gyro's bias, a torque b in the body, and d_w, d_a, how late wheel speeds and attitude are stamped against the gyro.
Without attitude C is integrated from the gyro, in windows that no gap interrupts, and g turns it: p is the window's
mean momentum, C h. With attitude there is no such term.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.estimators.least_squares import attitudes_after
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.telemetry.log import GAP, Log

ROWS_MIN = 8  # instants in a window
TURN_MAX = 0.3  # rad, from one reading to the next, beyond which the gyro alone does not give the attitude
_SPLINE_MIN = 4  # readings between gaps
_UNITS = inertia_tensors(np.eye(6))


@dataclass(frozen=True, eq=False, kw_only=True)
class Window:
    """Rows of one window, N instants by three body axes.

    Attributes:
        flight: number of the log.
        index: (N,) rows of the log.
        time: (N,) s.
        regressor: (N, 3, 6) L(omega), rad/s.
        common: (N, 3, m) columns of what is common to a flight: g, b, d_w and, where attitude is measured, d_a.
        own: (N, 3, 6 + 2 k) columns of H, of tau times the window's length, and of each mode's free oscillation.
        target: (N, 3) -a, what a known torque has added to the momentum, and what modes take from it, N m s.
        motion: (N, 3) change of the momentum for a second's error of a stamp, N m.
        instrument: (N, 3, 6) L of the rate that the readings before and after give for the instant.
    """

    flight: int
    index: np.ndarray
    time: np.ndarray
    regressor: np.ndarray
    common: np.ndarray
    own: np.ndarray
    target: np.ndarray
    motion: np.ndarray
    instrument: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    @property
    def omega(self) -> np.ndarray:
        """Rates (N, 3), rad/s."""
        return self.regressor[:, [0, 1, 2], [0, 1, 2]]


def regressor(omega: np.ndarray) -> np.ndarray:
    """L (N, 3, 6) of rates (N, 3)."""
    return np.einsum("pij,nj->nip", _UNITS, omega)


def windows_of(
    log: Log,
    flight: int,
    wheels: ReactionWheels,
    theta: np.ndarray,
    delays: np.ndarray,
    bias: np.ndarray,
    length: float,
    *,
    unbroken: bool = False,
    straight: bool = False,
    breaks: Sequence[float] = (),
) -> list[Window]:
    """Windows of a log.

    Args:
        log: readings.
        flight: its number.
        wheels: as built.
        theta: (6,) present estimate, kg m^2, at which d_a is linear.
        delays: (2,) present d_w and d_a, s; the columns are for what is left of them.
        length: of a window, s.
        unbroken: whether no window goes on after a gap, for what happens in it matters.
        straight: whether wheel speeds run on straight lines between readings, instead of splines.
        breaks: s of the log's clock; instants at which a window ends.
    """
    channels = [log.rate, log.wheel_speed, *(part for part in (log.attitude, log.torque) if part is not None)]
    good = np.isfinite(np.hstack(channels)).all(axis=1)
    time, omega = log.time - log.time[0], log.rate - bias
    speed, change = _shifted(time, log.wheel_speed, good, delays[0], straight)
    good &= np.isfinite(speed).all(axis=1)
    index = np.flatnonzero(good)
    found = []
    broken = np.isin(np.arange(len(index)), np.searchsorted(log.time[index], breaks))[1:]
    if log.attitude is None:
        broken |= _lost(time[index], omega[index], log.interval)
    elif log.torque is not None or unbroken:  # nobody knows what it was in a gap
        broken |= np.diff(time[index]) > GAP * log.interval
    for part in _parts(time[index], broken, length, log.interval):
        rows = index[part]
        if len(rows) < ROWS_MIN:
            continue
        t, w = time[rows], omega[rows]
        a = speed[rows] @ (wheels.axes * wheels.inertia).T
        if log.attitude is None:
            attitude = attitudes_after(np.diff(t)[:, None] * 0.5 * (w[1:] + w[:-1]))
        else:
            attitude = (Rotation.from_quat(log.attitude[rows]) * Rotation.from_rotvec(delays[1] * w)).as_matrix()
        matrix = regressor(w)
        slope = change[rows] @ (wheels.axes * wheels.inertia).T
        turning = np.cross(w, matrix @ theta + a)
        lag = [slope] if log.attitude is None else [slope, turning]
        back = attitude.transpose(0, 2, 1)
        impulse = _integral(t, attitude)
        known = np.zeros_like(w)
        if log.torque is not None:
            known = np.einsum("nij,nj->ni", back, _integral(t, np.einsum("nij,nj->ni", attitude, log.torque[rows])))
        offset = np.tile(-inertia_tensors(theta), (len(t), 1, 1))
        if log.attitude is None:  # a bias turns the integrated attitude, too
            momentum = np.einsum("nij,nj->ni", attitude, matrix @ theta + a).mean(axis=0)
            offset = offset + back @ np.cross(momentum, impulse, axisb=1, axisc=1)
        body = np.concatenate([offset, -back @ impulse], axis=2)
        since = ((t - t.mean()) / length)[:, None, None]
        found.append(
            Window(
                flight=flight,
                index=rows,
                time=log.time[rows],
                regressor=matrix,
                common=np.concatenate([body, np.stack(lag, axis=2)], axis=2),
                own=np.concatenate([back, back * since], axis=2),
                target=known - a,
                instrument=regressor(_between(t, w)),
                motion=np.hypot(slope, turning) if log.attitude is not None else np.abs(slope),
            )
        )
    return found


def _integral(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral of values (N, ...) from the first instant on, by trapezoids."""
    steps = np.diff(time).reshape(-1, *[1] * (values.ndim - 1))
    found = np.zeros_like(values)
    found[1:] = np.cumsum(0.5 * steps * (values[1:] + values[:-1]), axis=0)
    return found


def _lost(time: np.ndarray, omega: np.ndarray, interval: float) -> np.ndarray:
    """(N - 1,) whether the gyro alone does not give the attitude after it: a gap, or a turn too wide to integrate."""
    step = np.diff(time)
    turn = step * np.linalg.norm(0.5 * (omega[1:] + omega[:-1]), axis=1)
    return np.asarray((step > GAP * interval) | (turn > TURN_MAX))


def _parts(time: np.ndarray, broken: np.ndarray, length: float, interval: float) -> list[np.ndarray]:
    """Places of each window; none goes on where the rows are broken (N - 1,)."""
    if len(time) == 0:
        return []
    stretch = np.concatenate([[0], np.cumsum(broken)])
    parts = []
    for number in range(stretch[-1] + 1):
        here = np.flatnonzero(stretch == number)
        since = time[here] - time[here[0]]
        count = max(1, round(since[-1] / length))
        which = np.minimum((since / (since[-1] + interval) * count).astype(int), count - 1)
        parts += [here[which == k] for k in range(count)]
    return parts


def _shifted(
    time: np.ndarray, speed: np.ndarray, good: np.ndarray, delay: float, straight: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Wheel speeds (N, n) that were stamped `delay` s late, at the gyro's stamps, and their slopes; NaN where none.

    Cubic splines between gaps, because a line cuts the peaks of slow telemetry, and the inertia with them.
    """
    value, slope = np.full(speed.shape, np.nan), np.full(speed.shape, np.nan)
    index = np.flatnonzero(good)
    if len(index) < 2:
        return value, slope
    step = np.diff(time[index])
    for part in np.split(index, np.flatnonzero(step > GAP * np.median(step)) + 1):
        if len(part) < _SPLINE_MIN:
            continue
        t = time[part]
        spline = make_interp_spline(t, speed[part], k=1 if straight else 3)
        there = part[(t + delay >= t[0]) & (t + delay <= t[-1])]
        value[there] = spline(time[there] + delay) if delay != 0.0 else speed[there]
        slope[there] = (
            np.gradient(speed[part], t, axis=0)[np.isin(part, there)] if straight else spline(time[there] + delay, 1)
        )
    return value, slope


def _between(time: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Rates (N, 3) at each instant from the readings before and after it, on a line; at the ends of one."""
    share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    inner = (1.0 - share) * omega[:-2] + share * omega[2:]
    return np.concatenate([omega[1:2], inner, omega[-2:-1]])
