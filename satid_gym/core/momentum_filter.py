"""MomentumEKF: x = [M, theta, tau], with a = A j Omega from the tachometers a known input.

    predict   dM/dt = M x omega + tau,  omega = J(theta)^-1 (M - a);  theta and tau random walks
    measure   z = J(theta)^-1 (M - a) + noise,  R = sigma_gyro^2 1 + J^-1 N J^-1

N is the covariance of a. Wheel torque noise, wheel saturation and the motion of J need no model here: they
act through a, which is measured. Midpoint step; the Jacobians follow from
d(omega) = J^-1 dM - J^-1 L(omega) dtheta, where J omega = L(omega) theta.
Source: this project's design; the filter's form is that of Gelb, Applied Optimal Estimation (1974), ch. 6.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core import vetting, walk
from satid_gym.core.algebra import (
    add,
    add_diagonal,
    axpy,
    axpy_symmetric,
    congruence,
    cross,
    inverse,
    load,
    load_symmetric,
    multiply,
    store,
    store_symmetric,
    subtract,
)
from satid_gym.core.dynamics import wheel_axis
from satid_gym.core.jit import inline, outline
from satid_gym.core.kalman import (
    estimated_inertia,
    propagate,
    start_theta,
    update,
    write_cross_times,
    write_times_regressor,
)

_COARSE = 0.05  # relative std of a moment above which updates are iterated
_ITERATIONS = 4
_NOTHING = 5.0  # standard deviations of a rate that pass for noise


@inline
def wheel_momentum(belief, tachometer):
    """a = A j Omega of measured wheel speeds."""
    total = (0.0, 0.0, 0.0)
    for k in range(tachometer.shape[0]):
        total = axpy(belief.wheel_inertia[k] * tachometer[k], wheel_axis(belief.axes, k), total)
    return total


@inline
def start(belief, work, gyro, tachometer):
    """First mean and covariance: the prior on theta, and M0 = J omega + a of the first reading."""
    start_theta(belief)
    p = belief.prior_theta.shape[0]
    store(belief.wheel_input, wheel_momentum(belief, tachometer))
    vetting.begin(belief, gyro, tachometer)
    if belief.adaptive != 0:
        walk.start(belief)
    for i in range(3):
        belief.covariance[3 + p + i, 3 + p + i] = belief.prior_torque_std**2
    _start_momentum(belief, work, gyro)


@outline
def _start_momentum(belief, work, gyro):
    """M = J omega + a of one reading, with what is known of theta and with nothing of M before."""
    p = belief.prior_theta.shape[0]
    omega, a = load(gyro), load(belief.wheel_input)
    inertia = estimated_inertia(belief)
    store(belief.mean, add(multiply(inertia, omega), a))
    covariance, regressor, identity = belief.covariance, work.regressor, work.jacobian[0]
    store_symmetric(identity, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    write_times_regressor(identity, omega, regressor)
    s2 = belief.gyro_std**2
    noise = congruence(inertia, (s2, s2, s2, 0.0, 0.0, 0.0))
    moment = work.jacobian[1]
    store_symmetric(moment, axpy_symmetric(1.0, noise, load_symmetric(belief.wheel_momentum_covariance)))
    for i in range(3):
        for j in range(p + 3):
            total = 0.0
            for k in range(p):
                total += regressor[i, k] * covariance[3 + k, 3 + j]
            covariance[i, 3 + j] = covariance[3 + j, i] = total
    for i in range(3):
        for j in range(i, 3):
            total = moment[i, j]
            for k in range(p):
                total += covariance[i, 3 + k] * regressor[j, k]
            covariance[i, j] = covariance[j, i] = total


@inline
def _write_slope_jacobian(momentum, omega, flexibility, work, slot):
    """d(M x omega + tau) by M to work.jacobian[slot], by theta to work.sensitivity[slot]."""
    jacobian, sensitivity = work.jacobian[slot], work.sensitivity[slot]
    write_cross_times(momentum, flexibility, jacobian)
    write_times_regressor(jacobian, (-omega[0], -omega[1], -omega[2]), sensitivity)
    x, y, z = omega
    jacobian[0, 1] += z
    jacobian[0, 2] -= y
    jacobian[1, 0] -= z
    jacobian[1, 2] += x
    jacobian[2, 0] += y
    jacobian[2, 1] -= x


@outline
def predict(belief, work, tachometer, dt):
    """Move the belief from the last reading to this one, dt seconds later."""
    p = belief.prior_theta.shape[0]
    flexibility = inverse(estimated_inertia(belief))
    if belief.gate > 0.0:
        vetting.vet_tachometers(belief, tachometer, work.torque, dt)
        after = wheel_momentum(belief, belief.speed)
    else:
        after = wheel_momentum(belief, tachometer)
    if belief.adaptive != 0:
        walk.predict(belief, dt)
    before = load(belief.wheel_input)
    per_step = 1.0 / belief.substeps
    h = dt * per_step
    noise = congruence(flexibility, load_symmetric(belief.wheel_momentum_covariance))
    for step in range(belief.substeps):
        a0 = axpy(step * per_step, subtract(after, before), before)
        a1 = axpy((step + 0.5) * per_step, subtract(after, before), before)
        momentum, tau = load(belief.mean), load(belief.mean[3 + p :])
        omega = multiply(flexibility, subtract(momentum, a0))
        _write_slope_jacobian(momentum, omega, flexibility, work, 0)
        middle = axpy(0.5 * h, add(cross(momentum, omega), tau), momentum)
        omega = multiply(flexibility, subtract(middle, a1))
        _write_slope_jacobian(middle, omega, flexibility, work, 1)
        store(belief.mean, axpy(h, add(cross(middle, omega), tau), momentum))
        _write_transition(work, p, h)
        propagate(belief, work, h)
        _add_tachometer_noise(belief, work, middle, noise, h * dt)
    if belief.gate > 0.0:
        vetting.inflate_momentum(belief, flexibility, dt)
    store(belief.wheel_input, after)


@inline
def _write_transition(work, p, h):
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
def _add_tachometer_noise(belief, work, momentum, noise, h2):
    """P_MM += h2 [M x] J^-1 N J^-1 [M x]^T: what tachometer noise does to the predicted momentum."""
    half = work.jacobian[2]
    write_cross_times(momentum, noise, half)
    x, y, z = momentum
    for i in range(3):
        a, b, c = h2 * half[i, 0], h2 * half[i, 1], h2 * half[i, 2]
        row = (c * y - b * z, a * z - c * x, b * x - a * y)
        for j in range(i, 3):
            belief.covariance[i, j] = belief.covariance[j, i] = belief.covariance[i, j] + row[j]


@inline
def rate(belief):
    """Estimated omega = J^-1 (M - a) at the last reading."""
    residual = subtract(load(belief.mean), load(belief.wheel_input))
    return multiply(inverse(estimated_inertia(belief)), residual)


@inline
def condition(belief, work, gyro):
    """Update with one gyro reading (3,); returns the normalised innovation squared (3 degrees of freedom).

    While a moment is known to no better than 5 %, the update is iterated (Gauss-Newton on the posterior):
    omega is far from linear in theta there, and what one linearisation leaves is never forgotten.
    Source: Bell and Cathey, The iterated Kalman filter update as a Gauss-Newton method (1993).
    """
    gated = belief.gate > 0.0
    if gated and vetting.is_repeated(belief, gyro):
        return 0.0
    _linearise(belief, work, gyro)
    if gated:
        verdict = vetting.REINITIALISE
        if not vetting.is_momentum_lost(belief):
            verdict = vetting.reject(belief, work, 3 + belief.prior_theta.shape[0])
        if verdict > 0.0:
            return verdict
        if verdict == vetting.REINITIALISE:
            _start_momentum(belief, work, gyro)
            belief.coasting = belief.confirmed = belief.rejections = 0
            return 0.0
    belief.coasting, belief.confirmed = 0, 1
    momentum = load(belief.mean)
    nis = _update(belief, work, gyro)
    if gated:
        vetting.follow_unmeasured_wheels(belief, momentum)
    return nis


@outline
def _update(belief, work, gyro):
    """Update by the reading, which is linearised about the mean in work."""
    support = 3 + belief.prior_theta.shape[0]
    if belief.adaptive != 0 and not _is_coarse(belief) and walk.has_stepped(belief, work):
        walk.step(belief)
    if not _is_coarse(belief):
        if belief.adaptive == 0:
            return update(belief, work, 3, support)
        walk.keep(belief, work)
        nis = update(belief, work, 3, support)
        walk.learn(belief, work)
        return nis
    if belief.adaptive != 0:
        walk.forget(belief)
    size, prior_mean, prior = belief.mean.shape[0], work.prior_mean, work.prior_covariance
    _copy(belief.mean, belief.covariance, prior_mean, prior, size)
    nis, guarded = 0.0, belief.guarded
    for iteration in range(_ITERATIONS):
        if iteration > 0:
            _linearise(belief, work, gyro)
        for r in range(3):
            for k in range(support):
                work.innovation[r] -= work.rows[r, k] * (prior_mean[k] - belief.mean[k])
        _copy(prior_mean, prior, belief.mean, belief.covariance, size)
        nis = update(belief, work, 3, support)
    belief.guarded = min(belief.guarded, guarded + 1)
    return nis


@inline
def _is_coarse(belief):
    """Whether a moment is known to no better than 5 %."""
    coarse = False
    for k in range(3):
        coarse = coarse or belief.covariance[3 + k, 3 + k] > (_COARSE * belief.mean[3 + k]) ** 2
    return coarse


@inline
def _copy(mean, covariance, to_mean, to_covariance, size):
    for i in range(size):
        to_mean[i] = mean[i]
        for j in range(size):
            to_covariance[i, j] = covariance[i, j]


@inline
def _beyond(rate, spin, noise):
    """The rate where it stands out of its noise, of variance spin (1 - spin / noise); else 0."""
    return rate if rate * rate > _NOTHING**2 * spin * (1.0 - spin / noise) else 0.0


@outline
def _linearise(belief, work, gyro):
    """Whitened rows and innovation of the gyro reading about the filter's mean.

    The derivative by theta is taken at the rate that reading and prediction together make most likely,
    omega + S R^-1 (z - omega), S = J^-1 N J^-1: the tachometers' noise is in the prediction and so in the
    innovation, and would bias theta if it were in the derivative as well. A component within five of its
    standard deviations is taken as none: noise is no excitation.
    """
    p = belief.prior_theta.shape[0]
    flexibility = inverse(estimated_inertia(belief))
    omega = multiply(flexibility, subtract(load(belief.mean), load(belief.wheel_input)))
    residual = subtract(load(gyro), omega)
    spin = congruence(flexibility, load_symmetric(belief.wheel_momentum_covariance))
    noise = add_diagonal(belief.gyro_std**2, spin)
    likely = add(omega, multiply(spin, multiply(inverse(noise), residual)))
    likely = (
        _beyond(likely[0], spin[0], noise[0]),
        _beyond(likely[1], spin[1], noise[1]),
        _beyond(likely[2], spin[2], noise[2]),
    )
    rows, jacobian = work.rows, work.jacobian[0]
    store_symmetric(jacobian, flexibility)
    write_times_regressor(jacobian, (-likely[0], -likely[1], -likely[2]), work.regressor)
    for i in range(3):
        for j in range(3):
            rows[i, j] = jacobian[i, j]
        for k in range(p):
            rows[i, 3 + k] = work.regressor[i, k]
    store(work.innovation, residual)
    _whiten(work, noise, 3 + p)


@inline
def _whiten(work, noise, support):
    """Divide rows and innovation by the Cholesky factor of their noise covariance."""
    rows, innovation = work.rows, work.innovation
    l00 = np.sqrt(noise[0])
    l10, l20 = noise[3] / l00, noise[4] / l00
    l11 = np.sqrt(noise[1] - l10 * l10)
    l21 = (noise[5] - l20 * l10) / l11
    l22 = np.sqrt(noise[2] - l20 * l20 - l21 * l21)
    for j in range(support):
        r0 = rows[0, j] / l00
        r1 = (rows[1, j] - l10 * r0) / l11
        rows[0, j], rows[1, j], rows[2, j] = r0, r1, (rows[2, j] - l20 * r0 - l21 * r1) / l22
    y0 = innovation[0] / l00
    y1 = (innovation[1] - l10 * y0) / l11
    innovation[0], innovation[1], innovation[2] = y0, y1, (innovation[2] - l20 * y0 - l21 * y1) / l22
