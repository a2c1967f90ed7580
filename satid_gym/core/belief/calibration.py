"""Calibration: errors of gyro and wheels as states of the MomentumEKF, estimated together with the inertia.

    reading        z = (1 + G) omega + b + noise
    wheels         a = sum_k (j_k A_k + e_k) Omega_k

The tachometers' delay and the errors of encoders, which are states as well, are those of `alignment`.

b (3) is the gyro's bias, G (3 x 3, by rows) its scale and misalignment, e_k (3) the error of wheel k's momentum by
speed: relative rotor inertia along its axis, misalignment across it. All start at zero with the tolerances' covariance;
b walks, the others stay.

M, J, tau and all of j_k A_k + e_k multiplied by one factor give the same readings, so no excitation finds the common
error of the rotor inertias. A filter that carried it as a state would take its own linearisation errors for
information on it; here the e_k have prior covariance without their common part, and theta's covariance is reported
with it, as `scale_variance` times theta theta^T (see `kalman.theta_covariance`).
Source: this project's design; for the loss of consistency that is avoided, Huang, Mourikis and Roumeliotis,
Analysis and improvement of the consistency of extended Kalman filter based SLAM (2008).
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import add, axpy, load, store, subtract
from satid_gym.core.belief.kalman import estimated_inertia, write_cross_times
from satid_gym.core.belief.modes import body_inertia
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.wheels import wheel_momentum


@functools.cache
def calibration_dtype(n: int, states: int) -> np.dtype:
    """Calibration: places of its states in the filter's mean, and what is known of them before launch."""
    return np.dtype(
        [
            ("bias", INT),  # index of b in the mean; 0: none
            ("gain", INT),  # of G
            ("delay", INT),  # of the tachometers, see `alignment`
            ("wheels", INT),  # of e
            ("spins", INT),  # of the first error of the wheels' momentum: e, then the encoders', see `alignment`
            ("spin_count", INT),  # of these, 3 states each
            ("spin_scale", FLOAT, states),  # da = scale d error: wheel speeds for e, -c for an encoder's
            ("prior_covariance", FLOAT, (states, states)),
            ("speed_before", FLOAT, n),  # wheel speeds that the prediction began with
        ],
        align=True,
    )


@inline
def start(belief):
    """Covariance of the errors before the first reading."""
    c = belief.calibration
    states = c.prior_covariance.shape[0]
    first = belief.mean.shape[0] - states
    for i in range(states):
        for j in range(states):
            belief.covariance[first + i, first + j] = c.prior_covariance[i, j]


@inline
def _gain_times(belief, v):
    """(1 + G) v."""
    g = belief.calibration.gain
    if g == 0:
        return v
    x, y, z = v
    G = belief.mean[g : g + 9]
    return (
        x + G[0] * x + G[1] * y + G[2] * z,
        y + G[3] * x + G[4] * y + G[5] * z,
        z + G[6] * x + G[7] * y + G[8] * z,
    )


@inline
def _bias(belief):
    b = belief.calibration.bias
    return load(belief.mean[b : b + 3]) if b > 0 else (0.0, 0.0, 0.0)


@inline
def reading_of(belief, omega):
    """Reading (1 + G) omega + b that the gyro is expected to give."""
    return add(_gain_times(belief, omega), _bias(belief))


@inline
def corrected(belief, gyro):
    """Rate that a reading stands for, to first order in G."""
    reading = subtract(load(gyro), _bias(belief))
    return subtract(axpy(2.0, reading, (0.0, 0.0, 0.0)), _gain_times(belief, reading))


@inline
def wheel_input(belief, speed):
    """a of wheel speeds (n,), with the errors' estimates, N m s; they are those that derivatives are taken at."""
    a = wheel_momentum(belief, speed)
    c = belief.calibration
    if c.wheels > 0:
        for k in range(speed.shape[0]):
            c.spin_scale[k] = speed[k]
    for k in range(c.spin_count):
        a = axpy(c.spin_scale[k], load(belief.mean[c.spins + 3 * k : c.spins + 3 * k + 3]), a)
    return a


@inline
def take_up(belief):
    """Take a at the errors that an update has estimated."""
    if belief.calibration.prior_covariance.shape[0] > 0:
        store(belief.wheel_input, wheel_input(belief, belief.speed))


@inline
def begin_prediction(belief):
    """Note the wheel speeds of the last reading."""
    if belief.calibration.wheels > 0:
        for k in range(belief.speed.shape[0]):
            belief.calibration.speed_before[k] = belief.speed[k]


@outline
def write_start_rows(belief, omega, rows):
    """Derivative of the first M = J omega + a by the errors, to rows (3, size), where omega (3,) was read."""
    c, J = belief.calibration, body_inertia(belief, belief.mean, estimated_inertia(belief))
    inertia = ((J[0], J[3], J[4]), (J[3], J[1], J[5]), (J[4], J[5], J[2]))
    for i in range(3):
        for j in range(3):
            if c.bias > 0:
                rows[i, c.bias + j] = -inertia[i][j]
            if c.gain > 0:
                for k in range(3):
                    rows[i, c.gain + 3 * j + k] = -inertia[i][j] * omega[k]
        for k in range(c.spin_count):
            for j in range(3):
                rows[i, c.spins + 3 * k + j] = c.spin_scale[k] if i == j else 0.0


@outline
def complete_rows(belief, likely, rows, filled):
    """Turn rows (3, size) of omega by M and theta into those of the reading, and add its derivative by the errors.

    `likely` (3,) is the rate at which the derivative is taken, `filled` the number of columns that are.
    """
    c = belief.calibration
    for j in range(filled):
        rows[0, j], rows[1, j], rows[2, j] = _gain_times(belief, (rows[0, j], rows[1, j], rows[2, j]))
    for i in range(3):
        for j in range(3):
            if c.bias > 0:
                rows[i, c.bias + j] = 1.0 if i == j else 0.0
            if c.gain > 0:
                for k in range(3):
                    rows[i, c.gain + 3 * j + k] = likely[k] if i == j else 0.0
            for k in range(c.spin_count):
                rows[i, c.spins + 3 * k + j] = -rows[i, j] * c.spin_scale[k]


@outline
def complete_transition(belief, work, momenta, J_inv, shares, h):
    """Add to the first three rows of a midpoint step's Jacobian the derivative by the wheels' errors.

    Args:
        belief: belief.
        work: scratch space; jacobian[1] is the slope's by M at the second stage.
        momenta: M at both stages.
        J_inv: J^-1 (symmetric).
        shares: of the prediction that has passed at both stages.
        h: s.
    """
    c = belief.calibration
    for k in range(c.spin_count):  # those of encoders, which bring nothing worth mention into M
        for i in range(3):
            for j in range(3):
                work.transition[i, c.spins + 3 * k + j] = 0.0
    if c.wheels == 0:
        return
    first, second, slope, transition = work.jacobian[2], work.jacobian[3], work.jacobian[1], work.transition
    write_cross_times(momenta[0], J_inv, first)
    write_cross_times(momenta[1], J_inv, second)
    for k in range(belief.speed.shape[0]):
        before, change = c.speed_before[k], belief.speed[k] - c.speed_before[k]
        early, middle = before + shares[0] * change, before + shares[1] * change
        for i in range(3):
            for j in range(3):
                total = middle * second[i, j]
                for q in range(3):
                    total += 0.5 * h * early * slope[i, q] * first[q, j]
                transition[i, c.wheels + 3 * k + j] = -h * total
