"""Onboard loop: the part of a decision that needs readings alone, for a flight whose truth is not simulated here.

It calls what an episode calls, on a record of readings in the place of the truth.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core import episode
from satid_gym.core.belief import filters
from satid_gym.core.control.motors import forget_last
from satid_gym.core.control.rate_tracking import track
from satid_gym.core.jit import kernel
from satid_gym.core.observation import observe
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.report import note_nis
from satid_gym.onboard.gap import widen


@functools.cache
def readings_dtype(n: int) -> np.dtype:
    """Readings of one instant, rad/s, in the fields that the truth's record has for them."""
    return np.dtype([("gyro", FLOAT, 3), ("tachometer", FLOAT, n), ("gyro_flagged", INT)], align=True)


@kernel
def begin(readings, beliefs, tasks, work, observations):
    """Belief and observation after the first readings."""
    filters.start(beliefs[0], work[0], readings[0].gyro, readings[0].tachometer)
    observe(beliefs[0], tasks[0], readings[0].gyro, readings[0].tachometer, observations[0])


@kernel
def steer(readings, beliefs, tasks, work, dt):
    """Torque of the rate loop, to work.torque, until the next readings; dt seconds after it was steered last."""
    track(tasks[0], beliefs[0], readings[0].gyro, readings[0].tachometer, dt, work[0].torque)


@kernel
def let_go(tasks):
    """Tell the rate loop that no torque is commanded until it is steered again."""
    forget_last(tasks[0].tracking.motors)


@kernel
def cross_gap(beliefs, tasks, gap):
    """Widen the belief for a gap of so many seconds that `take` is about to cross."""
    widen(beliefs[0], tasks[0].torque_max, gap)


@kernel
def take(readings, beliefs, tasks, work, dt, observations):
    """Belief and observation after readings dt seconds later; normalised innovation squared per degree of freedom."""
    filters.predict(beliefs[0], work[0], readings[0].tachometer, dt)
    nis = episode.take_reading(readings[0], beliefs[0], work[0])
    note_nis(tasks[0], nis)
    observe(beliefs[0], tasks[0], readings[0].gyro, readings[0].tachometer, observations[0])
    return nis
