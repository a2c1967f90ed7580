"""Attitude: its error as a state of the MomentumEKF, with the inertia, where there is a star tracker.

The estimate is a quaternion q, the error psi (3) a small rotation vector in the inertial frame, q_true = exp(psi) q.
The filter's own rate, omega = J^-1 (M - a), turns q on, so that its errors turn psi:

    dq/dt = q * omega / 2,   dpsi/dt = R(q) d omega,   d omega = J^-1 (dM - L(omega) dtheta - sum_k Omega_k de_k)

With M as another state that omega turns, this tells of the momentum in inertial space, R M, which the wheels cannot
change. Noise of the tachometers enters M and psi as one and the same. A reading measures psi,

    q_read q^-1 = exp(psi + noise),   N = s_a^2 (1 - b b^T) + s_r^2 b b^T,   b: boresight, inertial frame

After each update q takes up the mean of psi. The attitude begins with a reading, and again with another where nobody
knows how far the body has turned since, and with each reading while theta is coarse after a step. Where the inertia
steps, or a mass moves, the rate was wrong for a part of a sample, which the covariance takes up.
Source: Lefferts, Markley, Shuster, Kalman filtering for spacecraft attitude estimation (1982); Markley, Attitude error
representations for Kalman filtering (2003). The rate being the filter's own, not the gyro's, is this project's design.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import axpy, load, multiply, norm, store, store_symmetric, subtract
from satid_gym.core.belief import momentum_model, rate_noise
from satid_gym.core.belief.kalman import write_cross_times, write_times_regressor
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.rotation import load_quaternion, product, store_quaternion, to_inertial, turn

_KNOWN = 0.1  # rad, std about any axis beyond which the attitude begins again: the error is no small angle


@functools.cache
def attitude_dtype(trackers: int, lines: int) -> np.dtype:
    """Attitude: what is known of the star tracker, if there is one, and the estimate.

    `lines`: room for readings that are aligned.
    """
    return np.dtype(
        [
            ("first", INT),  # index of psi in the mean
            ("across_variance", FLOAT),  # s_a^2
            ("round_variance", FLOAT),  # s_r^2
            ("boresight", FLOAT, (trackers, 3)),  # unit vector, body frame
            ("known", INT),  # 0: it has not begun
            ("quaternion", FLOAT, 4),  # q, body to inertial, scalar last
            ("age", FLOAT),  # s since the last reading that was used; as long as the flight before the first
            ("span", FLOAT),  # s of the last prediction
            ("period", FLOAT),  # s, of samples
            ("noisy", INT),  # 0: the tracker is said to have no noise
            ("rejections", INT),  # by the gate, in a row
            ("last", FLOAT, 4),  # reading
            ("wait", INT),  # samples that a reading waits for the state, see `star_reading`
            ("line", FLOAT, (2 * lines, 4)),  # readings that wait, the latest first
            ("waits", INT, 2 * lines),  # 1: there is one
        ],
        align=True,
    )


@inline
def start(belief):
    """State before the first reading."""
    state = belief.attitude
    state.known, state.age, state.rejections = 0, 0.0, 0
    store_quaternion(state.last, (0.0, 0.0, 0.0, 0.0))
    drop_waiting(state)
    store_quaternion(state.quaternion, (0.0, 0.0, 0.0, 1.0))


@inline
def drop_waiting(state):
    """Forget the readings that wait."""
    for k in range(state.waits.shape[0]):
        state.waits[k] = 0


@inline
def forget(belief):
    """Let the attitude begin with the next reading."""
    state, covariance = belief.attitude, belief.covariance
    state.known = 0
    for i in range(3):
        for j in range(covariance.shape[0]):
            covariance[state.first + i, j] = covariance[j, state.first + i] = 0.0


@inline
def is_known(belief):
    """Whether it has begun, and its error is still a small angle."""
    state, variance = belief.attitude, 0.0
    for i in range(3):
        variance = max(variance, belief.covariance[state.first + i, state.first + i])
    return state.known != 0 and variance < _KNOWN**2


@inline
def _turned(state, omega, h):
    """The attitude after h seconds at the rate omega."""
    return product(load_quaternion(state.quaternion), turn(axpy(h, omega, (0.0, 0.0, 0.0))))


@outline
def _write_rate_rows(belief, work, momentum, omega, J_inv, shares, h):
    """d omega in the middle of a step by the state before it, to work.product (3, size).

    d omega = J^-1 (dM' - L(omega) dtheta - sum_k Omega_k de_k), M' = M + h / 2 (M x omega_0 + tau); arguments as for
    `predict`.
    """
    p, c, rows, first = belief.prior_theta.shape[0], belief.calibration, work.product, work.jacobian[2]
    store_symmetric(first, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    write_times_regressor(first, omega, work.regressor)
    for i in range(3):
        for j in range(rows.shape[1]):
            rows[i, j] = 0.0
        for j in range(3):
            rows[i, j] = 0.5 * h * work.jacobian[0, i, j]
        for j in range(p):
            rows[i, 3 + j] = 0.5 * h * work.sensitivity[0, i, j] - work.regressor[i, j]
        rows[i, i] += 1.0
        rows[i, 3 + p + i] = 0.5 * h
    if c.wheels > 0:
        write_cross_times(momentum, J_inv, first)
        for k in range(belief.speed.shape[0]):
            before, change = c.speed_before[k], belief.speed[k] - c.speed_before[k]
            early, middle = before + shares[0] * change, before + shares[1] * change
            for i in range(3):
                for j in range(3):
                    rows[i, c.wheels + 3 * k + j] = -0.5 * h * early * first[i, j] - (middle if i == j else 0.0)
    for j in range(rows.shape[1]):
        rows[0, j], rows[1, j], rows[2, j] = multiply(J_inv, (rows[0, j], rows[1, j], rows[2, j]))


@inline
def begin_prediction(work):
    """Begin the derivative of the attitude by the state before a prediction, work.attitude (3, size)."""
    for i in range(3):
        for j in range(work.attitude.shape[1]):
            work.attitude[i, j] = 0.0


@outline
def turn_on(belief, work, omega, by_state, h):
    """Turn the attitude on for h seconds at a rate, whose derivative by the state before is `by_state` (3, size)."""
    state, rows = belief.attitude, work.attitude
    middle = _turned(state, omega, 0.5 * h)
    for j in range(belief.mean.shape[0]):
        column = to_inertial(middle, (by_state[0, j], by_state[1, j], by_state[2, j]))
        for i in range(3):
            rows[i, j] += h * column[i]
    store_quaternion(state.quaternion, _turned(state, omega, h))


@outline
def propagate(belief, work):
    """Take what `turn_on` has gathered to the covariance of psi, before that of the other states is propagated."""
    covariance, rows, change = belief.covariance, work.attitude, work.product
    size, first = covariance.shape[0], belief.attitude.first
    for i in range(3):
        for j in range(size):
            total = 0.0
            for k in range(size):
                total += rows[i, k] * covariance[k, j]
            change[i, j] = total
    for i in range(3):
        for j in range(size):
            if j < first or j >= first + 3:
                covariance[first + i, j] = covariance[j, first + i] = covariance[first + i, j] + change[i, j]
    for i in range(3):
        for j in range(i, 3):
            total = change[i, first + j] + change[j, first + i]
            for k in range(size):
                total += change[i, k] * rows[j, k]
            own = covariance[first + i, first + j] + total
            covariance[first + i, first + j] = covariance[first + j, first + i] = own


@outline
def predict(belief, work, momentum, rates, J_inv, shares, h):
    """Turn the attitude of a rigid body and its error on by a midpoint step, before its covariance is propagated.

    Args:
        belief, work: jacobian[0] and sensitivity[0] are the slope's by M and theta at the first stage.
        momentum: M at the first stage.
        rates: omega at the second stage, and the rate at which it is derived by theta.
        J_inv, shares, h: J^-1 (symmetric), shares of the prediction that has passed at both stages, and s.
    """
    begin_prediction(work)
    _write_rate_rows(belief, work, momentum, rates[1], J_inv, shares, h)
    turn_on(belief, work, rates[0], work.product, h)
    propagate(belief, work)


@outline
def doubt(belief, work, change):
    """Add to the covariance what the rate was off in the last prediction: the inertia changed within it.

    `change` is its std, relative. Where the attitude is not known nothing is added.
    """
    state = belief.attitude
    if state.boresight.shape[0] == 0 or state.known == 0:
        return
    momentum = load(belief.mean)
    omega = multiply(momentum_model.inverse_inertia(belief), momentum_model.body_momentum(belief))
    variance = (change * norm(omega)) ** 2
    rate_noise.add(belief, work, momentum, (variance, variance, variance, 0.0, 0.0, 0.0), state.span**2)


@inline
def take_up(belief):
    """Move the mean of psi into the attitude."""
    state, mean = belief.attitude, belief.mean
    psi = load(mean[state.first : state.first + 3])
    store_quaternion(state.quaternion, product(turn(psi), load_quaternion(state.quaternion)))
    store(mean[state.first : state.first + 3], (0.0, 0.0, 0.0))


@inline
def reference(belief, J_inv):
    """What to add to the rate along a prediction that now begins, where derivatives by theta are taken.

    In errors of the rate that is how far `reference_rate`, free of the tachometers' noise, is from the first.
    """
    if belief.rate_coordinates == 0 or belief.stepped != 0:
        return 0.0, 0.0, 0.0
    return subtract(load(belief.reference_rate), multiply(J_inv, momentum_model.body_momentum(belief)))
