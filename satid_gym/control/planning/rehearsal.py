"""Rehearsal: plans of body rates, flown ahead by the filter that flies, from what it believes, without noise.

The filter's own equations move the belief on, along the wheel speeds that the rate loop would command. Each reading is
the one that the filter expects, so that its covariance is the one it would have if its estimate were true (certainty
equivalence). All that the filter knows takes part: modes, errors of sensors and wheels, the attitude, and what blinds
the star tracker. Belief, task and data sheet are read, nothing of the truth.
Source: this project's design; certainty equivalence as in Bertsekas, Dynamic Programming and Optimal Control, ch. 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from satid_gym.control.planning import mode_doubles
from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    cross,
    inverse,
    load,
    load_symmetric,
    multiply,
    norm,
    store,
    subtract,
)
from satid_gym.core.belief import calibration, filters, modes, star_reading
from satid_gym.core.belief.kalman import estimated_inertia
from satid_gym.core.control.rate_tracking import track
from satid_gym.core.factors import factor
from satid_gym.core.jit import inline, outline
from satid_gym.core.rotation import store_quaternion, to_inertial
from satid_gym.core.sky import is_blind, is_off_target
from satid_gym.core.wheels import along_axis, sum_wheels

_SAME = 1e-9  # s, within which two instants are one
_BEYOND = 10.0  # by which a bend of one limit beyond the limit counts, over the expected error
_ON_TARGET = 0.5  # of what an imaging window allows: noise, which is not rehearsed, takes the rest


class Flights(NamedTuple):
    """N flights at a decision.

    Attributes:
        beliefs, tasks: records.
        trackers: records of the star tracker's data sheet, the Sun's direction, and since when each tracks.
    """

    beliefs: np.ndarray
    tasks: np.ndarray
    trackers: np.ndarray


class Trail(NamedTuple):
    """Rehearsals, R of them; of a plan of H decisions R = H + 1: row d is what decision d begins with.

    Attributes:
        beliefs, tasks, trackers: (R,) as in `Flights`.
        spins: (R, n) momentum of each wheel about its axis, N m s.
        doubles: (R, modes, 2, 3) see `mode_doubles`.
        losses: (R,) sum over decisions of the error that the filter expects, more where the body bends too far or an
            imaging window is missed.
    """

    beliefs: np.ndarray
    tasks: np.ndarray
    trackers: np.ndarray
    spins: np.ndarray
    doubles: np.ndarray
    losses: np.ndarray

    @classmethod
    def of(cls, flights: Flights, count: int) -> Trail:
        """Room for that many rows."""
        wheels, oscillators = sizes(flights)
        return cls(
            beliefs=np.empty(count, flights.beliefs.dtype),
            tasks=np.empty(count, flights.tasks.dtype),
            trackers=np.empty(count, flights.trackers.dtype),
            spins=np.empty((count, wheels)),
            doubles=np.empty((count, oscillators, 2, mode_doubles.FIELDS)),
            losses=np.empty(count),
        )


class Scratch(NamedTuple):
    """Scratch space: of the filter (1,), readings of gyro (3,), tachometers (n,) and tracker (4,), and theta (p, p)."""

    work: np.ndarray
    gyro: np.ndarray
    tachometer: np.ndarray
    attitude: np.ndarray
    theta: np.ndarray


def sizes(flights: Flights) -> tuple[int, int]:
    """Number of wheels, and of modes, of each flight."""
    return flights.beliefs["wheel_inertia"].shape[1], flights.beliefs["modes"]["coupling"].shape[1]


@inline
def copy_row(source, target, d):
    """Copy row d of one trail to another."""
    target.beliefs[d], target.tasks[d], target.trackers[d] = source.beliefs[d], source.tasks[d], source.trackers[d]
    target.spins[d], target.doubles[d], target.losses[d] = source.spins[d], source.doubles[d], source.losses[d]


@inline
def _expected_error(belief, scratch):
    """Geometric mean of theta's stds over its scale, but for a factor no excitation finds; inf: the filter broke."""
    p = belief.prior_theta.shape[0]
    for i in range(p):
        for j in range(p):
            scratch.theta[i, j] = belief.covariance[3 + i, 3 + j] / (belief.theta_scale[i] * belief.theta_scale[j])
    determinant = factor(scratch.theta, 0, p, scratch.work[0].block)
    return determinant ** (0.5 / p) if determinant > 0.0 else np.inf


@inline
def _time(task, samples):
    """Time since the start, s, `samples` samples after the decision began."""
    return (task.decision * task.samples + samples) * task.sample_period


@inline
def track_stars(belief, task, tracker, rate, time):
    """Note until when the tracker is blind; whether it sees stars at a time, s. With no attitude no sky blinds it."""
    phase = np.cos(task.orbit_rate * time), np.sin(task.orbit_rate * time)
    blind = is_blind(tracker, star_reading.present(belief), rate, phase)
    if belief.attitude.known == 0:
        blind = norm(rate) > tracker.rate_limit
    if blind:
        tracker.ready = time + tracker.reacquire
    return time >= tracker.ready - _SAME


@inline
def _drive(belief, task, spin, torque):
    """Turn the torque (n,) that motors are commanded into what they are expected to give, and move the wheels on."""
    motors = task.tracking.motors
    for k in range(torque.shape[0]):
        limit, most = task.torque_max[k], belief.wheel_inertia[k] * task.wheel_speed_max[k]
        lost = limit * (motors.friction[k] * np.sign(spin[k]) + motors.missing[k])
        given = min(max(motors.gain[k] * torque[k] - lost, -limit), limit)
        after = min(max(spin[k] + given * task.sample_period, -most), most)
        torque[k], spin[k] = (after - spin[k]) / task.sample_period, after


@inline
def write_speeds(belief, spin, omega, speed):
    """Write wheel speeds (n,), rad/s, of momenta (n,) about the axes at a body rate."""
    for k in range(spin.shape[0]):
        speed[k] = spin[k] / belief.wheel_inertia[k] - along_axis(belief.axes, k, omega)


@outline
def _rehearse_sample(belief, task, spin, scratch):
    """Move a belief on by a sample period; gyro and tachometers read what it expects. Returns the body rate."""
    work, tachometer, dt = scratch.work[0], scratch.tachometer, task.sample_period
    omega = filters.rate(belief)
    store(scratch.gyro, calibration.reading_of(belief, omega))
    track(task, belief, scratch.gyro, tachometer, dt, work.torque)
    _drive(belief, task, spin, work.torque)
    momentum, tau = filters.momentum_and_torque(belief)
    inertia = modes.body_inertia(belief, belief.mean, estimated_inertia(belief))
    free = axpy_symmetric(-1.0, load_symmetric(task.tracking.rotor_inertia), inertia)
    push = axpy(-1.0, sum_wheels(belief.axes, work.torque), add(tau, cross(momentum, omega)))
    write_speeds(belief, spin, axpy(dt, multiply(inverse(free), push), omega), tachometer)
    filters.predict(belief, work, tachometer, dt)
    omega = filters.rate(belief)
    store(scratch.gyro, calibration.reading_of(belief, omega))
    filters.condition(belief, work, scratch.gyro, tachometer)
    return omega


@inline
def _rehearse_stars(belief, task, tracker, omega, time, scratch):
    """Let the star tracker read what the belief expects, where it sees stars and a reading is due."""
    if belief.attitude.boresight.shape[0] == 0 or not track_stars(belief, task, tracker, omega, time):
        return
    tracker.waited = (tracker.waited + 1) % tracker.every
    if tracker.waited == 0:
        store_quaternion(scratch.attitude, star_reading.present(belief))
        filters.condition_attitude(belief, scratch.work[0], scratch.attitude)


@inline
def _misses(belief, task, omega, time):
    """Whether an announced window is open and the payload, by the estimated attitude, not safely on its target."""
    if task.tells_window == 0 or time < task.opens or time - task.sample_period >= task.closes:
        return False
    boresight = to_inertial(star_reading.present(belief), load(task.payload))
    cosine = 1.0 - _ON_TARGET**2 * (1.0 - task.pointing_cosine)  # of a small angle
    return is_off_target(boresight, load(task.target), omega, cosine, _ON_TARGET * task.steadiness)


@outline
def begin(trail, row, flights, i, caution):
    """Write a row of a trail: flight i as it is."""
    trail.beliefs[row], trail.tasks[row] = flights.beliefs[i], flights.tasks[i]
    belief, task = trail.beliefs[row], trail.tasks[row]
    omega = filters.rate(belief)
    for k in range(trail.spins.shape[1]):
        trail.spins[row, k] = belief.wheel_inertia[k] * (belief.speed[k] + along_axis(belief.axes, k, omega))
    if belief.attitude.boresight.shape[0] > 0:
        track_stars(belief, task, flights.trackers[i], omega, _time(task, 0))
    trail.trackers[row] = flights.trackers[i]
    mode_doubles.begin(belief, trail.doubles[row], caution)
    trail.losses[row] = 0.0


@outline
def decide(trail, row, action, miss, scratch):
    """Move a row of a trail on by a decision for rates (3,) over their limit; returns what the decision loses.

    `miss` is the weight of imaging windows: a decision that misses one throughout loses 1 + miss times the expected
    error. With 0 they do not count.
    """
    belief, task, spin, bent, missed = trail.beliefs[row], trail.tasks[row], trail.spins[row], 0.0, 0
    write_speeds(belief, spin, filters.rate(belief), scratch.tachometer)
    for i in range(3):
        task.tracking.reference[i] = action[i] * task.rate_limit
    for sample in range(task.samples):
        before = filters.rate(belief)
        omega, time = _rehearse_sample(belief, task, spin, scratch), _time(task, sample + 1)
        _rehearse_stars(belief, task, trail.trackers[row], omega, time, scratch)
        if miss > 0.0:
            missed += _misses(belief, task, omega, time)
        turned = subtract(filters.rate(belief), before)
        farthest = mode_doubles.bend(belief, trail.doubles[row], turned, task.sample_period)
        bent = max(bent, max(farthest, modes.bend(belief)) - 1.0)
    task.decision += 1
    return _expected_error(belief, scratch) * (1.0 + _BEYOND * bent + miss * missed / task.samples)


@outline
def fly(trail, plan, first, worst, scratch):
    """Fly a plan (H, 3) of rates over their limit from decision `first` on, until its loss is beyond the worst."""
    ahead = plan.shape[0]
    for d in range(first, ahead):
        trail.beliefs[d + 1], trail.tasks[d + 1] = trail.beliefs[d], trail.tasks[d]
        trail.trackers[d + 1], trail.spins[d + 1] = trail.trackers[d], trail.spins[d]
        trail.doubles[d + 1] = trail.doubles[d]
        trail.losses[d + 1] = trail.losses[d] + decide(trail, d + 1, plan[d], 0.0, scratch)
        if trail.losses[d + 1] > worst:
            trail.losses[ahead] = trail.losses[d + 1]
            return
