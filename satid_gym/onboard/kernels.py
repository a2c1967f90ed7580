"""Onboard loop: the part of a decision that needs readings alone, for a flight whose truth is not simulated here.

It calls what an episode calls, on a record of readings in the place of the truth.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core import episode
from satid_gym.core.algebra import axpy, dot, inverse, load, multiply
from satid_gym.core.belief import attitude, filters
from satid_gym.core.belief.kalman import estimated_inertia
from satid_gym.core.control.motors import forget_last
from satid_gym.core.control.rate_tracking import track
from satid_gym.core.jit import inline, kernel
from satid_gym.core.observation import observe
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.report import note_nis
from satid_gym.core.wheels import wheel_axis

_MOMENTUM = int(filters.FilterKind.MOMENTUM)


@functools.cache
def readings_dtype(n: int) -> np.dtype:
    """Readings of one instant, rad/s and a quaternion, in the fields that the truth's record has for them."""
    tracker = np.dtype([("fresh", INT), ("reading", FLOAT, 4)], align=True)
    readings = [("gyro", FLOAT, 3), ("tachometer", FLOAT, n), ("gyro_flagged", INT), ("tracker", tracker)]
    return np.dtype(readings, align=True)


@functools.cache
def report_dtype() -> np.dtype:
    """What the filter says of itself, and how near to its limits the flight was, in the fields of an episode's."""
    return np.dtype(
        [
            ("nis_mean", FLOAT),
            ("colour", FLOAT),
            ("unmodelled", INT),
            ("inflation", FLOAT),
            ("restarts", INT),
            ("inertia_walk", FLOAT),
            ("steps_found", INT),
            ("peak_rate", FLOAT, 3),
            ("peak_bend", FLOAT),
        ]
    )


@kernel
def tell(beliefs, reports):
    """Write what the filter says of itself to a report."""
    filters.tell(beliefs[0], reports[0])


@kernel
def begin(readings, beliefs, tasks, work, observations):
    """Belief and observation after the first readings."""
    filters.start(beliefs[0], work[0], readings[0].gyro, readings[0].tachometer)
    if readings[0].tracker.fresh != 0:
        filters.condition_attitude(beliefs[0], work[0], readings[0].tracker.reading)
    observe(beliefs[0], tasks[0], readings[0].gyro, readings[0].tachometer, observations[0])


@kernel
def steer(readings, beliefs, tasks, work, dt):
    """Torque of the rate loop, to work.torque, until the next readings; dt seconds after it was steered last."""
    track(tasks[0], beliefs[0], readings[0].gyro, readings[0].tachometer, dt, work[0].torque)


@kernel
def let_go(tasks):
    """Tell the rate loop that no torque is commanded until it is steered again."""
    forget_last(tasks[0].tracking.motors)


@inline
def _widen(belief, torque_max, gap):
    """Add to the momentum's covariance what the wheels may have done in a gap, s; `torque_max` (n,) is in N m.

    Within the motors' limits u the body turns by up to J^-1 A u T^2 / 4 from where a line leads: at full torque for
    half the gap and back. Taken as uniform within that, the turn moves the momentum across itself. The RateEKF has no
    momentum, and keeps its covariance. Readings from before the gap that are aligned with later ones count as mixed
    until they have left the means. The attitude begins again with the star tracker's next reading.
    """
    if belief.alignment.gyro_line.shape[0] > 0:
        belief.alignment.mixed = belief.alignment.span + 1
    if belief.kind != _MOMENTUM:
        return
    if belief.attitude.boresight.shape[0] > 0:
        attitude.forget(belief)
        attitude.drop_waiting(belief.attitude)
    J_inv, turn = inverse(estimated_inertia(belief)), (0.0, 0.0, 0.0)
    for k in range(torque_max.shape[0]):
        x, y, z = multiply(J_inv, wheel_axis(belief.axes, k))
        turn = axpy(0.25 * gap * gap * torque_max[k], (abs(x), abs(y), abs(z)), turn)
    variance = max(turn[0], turn[1], turn[2]) ** 2 / 3.0
    momentum = load(belief.mean)
    square = dot(momentum, momentum)
    for i in range(3):
        belief.covariance[i, i] += variance * square
        for j in range(3):
            belief.covariance[i, j] -= variance * momentum[i] * momentum[j]


@kernel
def cross_gap(beliefs, tasks, gap):
    """Widen the belief for a gap (s) that `take` is about to cross."""
    _widen(beliefs[0], tasks[0].torque_max, gap)


@kernel
def take(readings, beliefs, tasks, work, dt, observations):
    """Belief and observation after readings dt seconds later; normalised innovation squared per degree of freedom."""
    filters.predict(beliefs[0], work[0], readings[0].tachometer, dt)
    nis = episode.take_reading(readings[0], beliefs[0], work[0])
    note_nis(tasks[0], nis)
    observe(beliefs[0], tasks[0], readings[0].gyro, readings[0].tachometer, observations[0])
    return nis
