"""RateEKF, the paper's filter: x = [omega, theta, Omega], Euler step, independent noise on every state.

    J omega' = -omega x (J omega + A j Omega) - A j alpha,   theta' = 0,   Omega' = alpha
    z = [omega, Omega] + noise

alpha is the wheels' acceleration between two readings. The filter knows no external torque.
Source: El Hariry et al. (arXiv 2510.16738), section III-E; constants in the estimator's settings.
"""

from __future__ import annotations

from satid_gym.core.algebra import (
    add,
    axpy,
    cross,
    inverse,
    load,
    multiply,
    store,
    store_symmetric,
)
from satid_gym.core.belief import whiteness
from satid_gym.core.belief.kalman import (
    estimated_inertia,
    propagate,
    start_theta,
    update,
    write_cross_times,
    write_times_regressor,
)
from satid_gym.core.jit import inline, outline
from satid_gym.core.wheels import along_axis, wheel_momentum

_IDENTITY = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)


@outline
def start(belief, work, gyro, tachometer):
    """First mean and covariance: the first reading, and the prior variances."""
    start_theta(belief)
    whiteness.start(belief)
    p = belief.prior_theta.shape[0]
    store(belief.mean, load(gyro))
    for i in range(3):
        belief.covariance[i, i] = belief.prior_std[0] ** 2
    for k in range(tachometer.shape[0]):
        belief.mean[3 + p + k] = tachometer[k]
        belief.wheel_input[k] = tachometer[k]
        belief.covariance[3 + p + k, 3 + p + k] = belief.prior_std[1] ** 2


@outline
def predict(belief, work, tachometer, dt):
    """Move the belief from the last reading to this one, dt seconds later, by one Euler step."""
    p, n = belief.prior_theta.shape[0], tachometer.shape[0]
    inertia = estimated_inertia(belief)
    J_inv = inverse(inertia)
    omega = load(belief.mean)
    momentum = add(multiply(inertia, omega), wheel_momentum(belief, belief.mean[3 + p :]))
    change = work.wheel
    for k in range(n):
        change[k] = (tachometer[k] - belief.wheel_input[k]) / dt
    motor = wheel_momentum(belief, change)
    torque = axpy(-1.0, motor, cross(momentum, omega))
    slope = multiply(J_inv, torque)

    # by omega: J^-1 ([(J omega + a) x] - [omega x] J); by theta: -J^-1 (L(slope) + [omega x] L(omega))
    turn, gyroscopic, times = work.jacobian[0], work.jacobian[1], work.jacobian[2]
    write_cross_times(momentum, _IDENTITY, turn)
    write_cross_times(omega, inertia, gyroscopic)
    write_cross_times(omega, _IDENTITY, times)
    write_times_regressor(times, omega, work.sensitivity[0])
    for i in range(3):
        for j in range(3):
            turn[i, j] -= gyroscopic[i, j]
    identity = work.jacobian[3]
    store_symmetric(identity, _IDENTITY)
    write_times_regressor(identity, slope, work.sensitivity[1])
    inverse_matrix = gyroscopic
    store_symmetric(inverse_matrix, J_inv)
    transition = work.transition
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += inverse_matrix[i, k] * turn[k, j]
            transition[i, j] = dt * total
        transition[i, i] += 1.0
        for j in range(p):
            total = 0.0
            for k in range(3):
                total += inverse_matrix[i, k] * (work.sensitivity[0, k, j] + work.sensitivity[1, k, j])
            transition[i, 3 + j] = -dt * total
        row = (inverse_matrix[i, 0], inverse_matrix[i, 1], inverse_matrix[i, 2])
        for k in range(n):
            # row . (-omega x axis) j
            transition[i, 3 + p + k] = dt * belief.wheel_inertia[k] * along_axis(belief.axes, k, cross(omega, row))
    store(belief.mean, axpy(dt, slope, omega))
    for k in range(n):
        belief.mean[3 + p + k] += dt * change[k]
        belief.wheel_input[k] = tachometer[k]
    propagate(belief, work, dt)


@inline
def rate(belief):
    """Estimated omega, rad/s."""
    return load(belief.mean)


@inline
def momentum(belief):
    """Estimated total momentum J omega + A j Omega, N m s."""
    spin = wheel_momentum(belief, belief.mean[3 + belief.prior_theta.shape[0] :])
    return add(multiply(estimated_inertia(belief), load(belief.mean)), spin)


@outline
def condition(belief, work, gyro, tachometer):
    """Update with gyro (3,) and tachometer (n,); normalised innovation squared, 3 + n degrees of freedom."""
    for i in range(3):
        _write_row(belief, work, i, i, gyro[i], belief.gyro_std)
    _write_wheel_rows(belief, work, 3, tachometer)
    return update(belief, work, 3 + tachometer.shape[0])


@outline
def condition_wheels(belief, work, tachometer):
    """Update with tachometer (n,) alone; normalised innovation squared, n degrees of freedom."""
    _write_wheel_rows(belief, work, 0, tachometer)
    return update(belief, work, tachometer.shape[0])


@inline
def _write_wheel_rows(belief, work, first, tachometer):
    """Rows of the tachometers, from row `first` on."""
    place = 3 + belief.prior_theta.shape[0]
    for k in range(tachometer.shape[0]):
        _write_row(belief, work, first + k, place + k, tachometer[k], belief.tachometer_std)


@inline
def _write_row(belief, work, r, state, reading, std):
    """Row r: a reading of one state with that noise."""
    for j in range(belief.mean.shape[0]):
        work.rows[r, j] = 0.0
    work.rows[r, state] = 1.0 / std
    work.innovation[r] = (reading - belief.mean[state]) / std
