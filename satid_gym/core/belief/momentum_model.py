"""Model of the MomentumEKF, linearised: its prediction's Jacobian, and a gyro reading's rows; see momentum_filter."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import (
    add,
    add_diagonal,
    axpy_symmetric,
    congruence,
    inverse,
    load,
    load_symmetric,
    multiply,
    store,
    store_symmetric,
    subtract,
)
from satid_gym.core.belief import alignment, calibration, modes, retraction
from satid_gym.core.belief.kalman import estimated_inertia, write_cross_times, write_times_regressor
from satid_gym.core.jit import inline, outline


@inline
def write_slope_jacobian(momentum, omega, J_inv, work, slot):
    """d(M x omega + tau) by M to work.jacobian[slot], by theta to work.sensitivity[slot]."""
    jacobian, sensitivity = work.jacobian[slot], work.sensitivity[slot]
    write_cross_times(momentum, J_inv, jacobian)
    write_times_regressor(jacobian, (-omega[0], -omega[1], -omega[2]), sensitivity)
    x, y, z = omega
    jacobian[0, 1] += z
    jacobian[0, 2] -= y
    jacobian[1, 0] -= z
    jacobian[1, 2] += x
    jacobian[2, 0] += y
    jacobian[2, 1] -= x


@inline
def write_transition(work, p, h):
    """First three rows of the midpoint step's Jacobian, from the slopes' Jacobians at its two stages."""
    first, second, transition = work.jacobian[0], work.jacobian[1], work.transition
    for i in range(3):
        for j in range(3):
            total = second[i, j]
            for k in range(3):
                total += 0.5 * h * second[i, k] * first[k, j]
            transition[i, j] = h * total
            transition[i, 3 + p + j] = 0.5 * h * h * second[i, j]
        transition[i, i] += 1.0
        transition[i, 3 + p + i] += h
        for j in range(p):
            total = work.sensitivity[1, i, j]
            for k in range(3):
                total += 0.5 * h * second[i, k] * work.sensitivity[0, k, j]
            transition[i, 3 + j] = h * total


@inline
def _beyond(rate, spin, noise):
    """The rate where it stands out of its noise, of variance spin (1 - spin / noise); else 0."""
    return rate if rate * rate > retraction.EXCITATION_SIGMAS**2 * spin * (1.0 - spin / noise) else 0.0


@inline
def _least(spin, noise):
    """Variances of the most likely rate, spin (1 - spin / noise), first in a symmetric tensor."""
    x, y, z = 1.0 - spin[0] / noise[0], 1.0 - spin[1] / noise[1], 1.0 - spin[2] / noise[2]
    return x * spin[0], y * spin[1], z * spin[2], 0.0, 0.0, 0.0


@inline
def write_rate_rows(belief, work, J_inv, rate, rows):
    """Derivative of the rate by M, theta and the modes, at a rate, to rows (3, size).

    Returns the number of columns that this fills; those behind are 0. Leaves J^-1 in work.jacobian[0].
    """
    p, jacobian = belief.prior_theta.shape[0], work.jacobian[0]
    store_symmetric(jacobian, J_inv)
    write_times_regressor(jacobian, (-rate[0], -rate[1], -rate[2]), work.regressor)
    for i in range(3):
        for j in range(3):
            rows[i, j] = jacobian[i, j]
        for k in range(p):
            rows[i, 3 + k] = work.regressor[i, k]
        for j in range(3 + p, rows.shape[1]):
            rows[i, j] = 0.0
    filled = 3 + p
    if belief.modes.coupling.shape[0] > 0:
        modes.write_rate_errors(belief, belief.mean, rate, rows)
        filled = 6 + p + modes.STATES * belief.modes.coupling.shape[0]
        for j in range(6 + p, filled):
            column = multiply(J_inv, modes.load_column(rows, j))
            rows[0, j], rows[1, j], rows[2, j] = column
    return filled


@outline
def linearise(belief, work, gyro):
    """Whitened rows and innovation of the gyro reading about the filter's mean.

    The derivative by theta is taken at the rate that reading and prediction together make most likely,
    omega + S R^-1 (z - omega), S = J^-1 N J^-1: the tachometers' noise is in the prediction and so in the
    innovation, and would bias theta if it were in the derivative as well. A component within five of its
    standard deviations is taken as none: noise is no excitation. In errors of the rate, `retraction` says where.
    """
    J_inv = inverse_inertia(belief)
    calibrated = belief.calibration.prior_covariance.shape[0] > 0
    calibration.take_up(belief)
    omega = multiply(J_inv, body_momentum(belief))
    reading = alignment.aligned_gyro(belief, gyro)
    residual = subtract(reading, calibration.reading_of(belief, omega) if calibrated else omega)
    spin = congruence(J_inv, load_symmetric(belief.wheel_momentum_covariance))
    noise = add_diagonal(belief.gyro_std**2, spin)
    likely = add(omega, multiply(spin, multiply(inverse(noise), residual)))
    if belief.rate_coordinates != 0:
        counted = belief.alignment.noise_taps > 0  # then the gyro may well be the better of the two
        likely = retraction.move_reference(belief, likely, _least(spin, noise) if counted else spin)
    else:
        likely = (
            _beyond(likely[0], spin[0], noise[0]),
            _beyond(likely[1], spin[1], noise[1]),
            _beyond(likely[2], spin[2], noise[2]),
        )
    rows = work.rows
    filled = write_rate_rows(belief, work, J_inv, likely, rows)
    if calibrated:
        calibration.complete_rows(belief, likely, rows, filled)
        if belief.calibration.delay > 0:
            alignment.write_delay_rows(belief, J_inv, spin, rows)
    if belief.alignment.noise_taps > 0:  # the tachometers' noise is in the states
        noise = add_diagonal(belief.gyro_std**2, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    store(work.innovation, residual)
    whiten(work, axpy_symmetric(belief.whiteness.factor - 1.0, noise, noise))


@inline
def inverse_inertia(belief):
    """J^-1 (symmetric) of the estimate, J less what moves freely in the modes."""
    return inverse(modes.body_inertia(belief, belief.mean, estimated_inertia(belief)))


@outline
def follow_own_rate(belief, J_inv):
    """Move the reference of the updates to the filter's own rate, where no gyro reading moves it."""
    omega = multiply(J_inv, body_momentum(belief))
    retraction.move_reference(belief, omega, congruence(J_inv, load_symmetric(belief.wheel_momentum_covariance)))


@inline
def body_momentum(belief):
    """M - a, and less what the modes carry: (J - sum d d^T) omega."""
    residual = subtract(load(belief.mean), load(belief.wheel_input))
    return residual if belief.modes.coupling.shape[0] == 0 else subtract(residual, modes.momentum(belief))


@inline
def whiten(work, noise):
    """Divide rows and innovation by the Cholesky factor of their noise covariance."""
    rows, innovation = work.rows, work.innovation
    l00 = np.sqrt(noise[0])
    l10, l20 = noise[3] / l00, noise[4] / l00
    l11 = np.sqrt(noise[1] - l10 * l10)
    l21 = (noise[5] - l20 * l10) / l11
    l22 = np.sqrt(noise[2] - l20 * l20 - l21 * l21)
    for j in range(rows.shape[1]):
        r0 = rows[0, j] / l00
        r1 = (rows[1, j] - l10 * r0) / l11
        rows[0, j], rows[1, j], rows[2, j] = r0, r1, (rows[2, j] - l20 * r0 - l21 * r1) / l22
    y0 = innovation[0] / l00
    y1 = (innovation[1] - l10 * y0) / l11
    innovation[0], innovation[1], innovation[2] = y0, y1, (innovation[2] - l20 * y0 - l21 * y1) / l22
