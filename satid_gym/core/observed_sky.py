"""Sky in the observation: how well the attitude is known, and by it Sun and Earth, and the payload's target."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import cross, dot, load, norm
from satid_gym.core.belief import attitude, star_reading
from satid_gym.core.jit import outline
from satid_gym.core.observed_number import write
from satid_gym.core.rotation import load_quaternion, to_body, to_inertial

WINDOW_UNIT = 60.0  # s, that an observed time to an opening or a closing is counted in


@outline
def attitude_std(belief, x, y, z):
    """Std of the attitude's error about an axis of the body frame, rad; 1 where the attitude is not known."""
    if not attitude.is_known(belief):
        return 1.0
    first = belief.attitude.first
    axis = to_inertial(load_quaternion(belief.attitude.quaternion), (x, y, z))
    variance = 0.0
    for i in range(3):
        for j in range(3):
            variance += axis[i] * belief.covariance[first + i, first + j] * axis[j]
    return np.sqrt(variance)


@outline
def observe_sky(belief, task, out, i):
    """Write the directions of Sun and Earth in the body frame, by the ephemeris and the estimated attitude.

    The Earth is where `core.truth.star_tracker` says; 0 where the attitude is not known.
    """
    known = 1.0 if attitude.is_known(belief) else 0.0
    q, angle = star_reading.present(belief), task.orbit_rate * task.decision * task.samples * task.sample_period
    if task.tells_sun != 0:
        sun = to_body(q, load(task.sun))
        for k in range(3):
            i = write(out, i, known * sun[k])
    if task.tells_earth != 0:
        earth = to_body(q, (np.cos(angle), np.sin(angle), 0.0))
        for k in range(3):
            i = write(out, i, known * earth[k])
    return i


@outline
def observe_window(belief, task, out, i):
    """Write how far off opening and closing are, and the turn that brings the payload's boresight to the target.

    The turn is a rotation vector in the body frame, the least there is, by the estimated attitude; 0 where that is not
    known.
    """
    time = task.decision * task.samples * task.sample_period
    i = write(out, i, (task.opens - time) / WINDOW_UNIT)
    i = write(out, i, (task.closes - time) / WINDOW_UNIT)
    here, target = load(task.payload), to_body(star_reading.present(belief), load(task.target))
    axis = cross(here, target)
    sine = norm(axis)
    turn = np.arctan2(sine, dot(here, target)) / sine if sine > 0.0 and attitude.is_known(belief) else 0.0
    for k in range(3):
        i = write(out, i, turn * axis[k])
    return i
