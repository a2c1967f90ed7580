"""MomentumEKF: x = [M, theta, tau], with a = A j Omega from the tachometers a known input.

    predict   dM/dt = M x omega + tau,  omega = J(theta)^-1 (M - a);  theta and tau random walks
    measure   z = J(theta)^-1 (M - a) + noise,  R = sigma_gyro^2 1 + J^-1 N J^-1

N is the covariance of a. Wheel torque noise, wheel saturation and the motion of J need no model here: they
act through a, which is measured. Midpoint step; the Jacobians follow from
d(omega) = J^-1 dM - J^-1 L(omega) dtheta, where J omega = L(omega) theta.
Source: this project's design; the filter's form is that of Gelb, Applied Optimal Estimation (1974), ch. 6.
"""

from __future__ import annotations

from satid_gym.core.algebra import (
    add,
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
from satid_gym.core.belief import adaptation, calibration, gating, momentum_model, retraction
from satid_gym.core.belief.kalman import (
    estimated_inertia,
    is_known_to,
    propagate,
    start_theta,
    update,
    write_times_regressor,
)
from satid_gym.core.jit import inline, outline

_ITERATE_ABOVE = 0.05  # relative std of a moment above which updates are iterated
_ITERATIONS = 4
_STEP_OVER = 0.01  # relative std of the moments at which a step of the inertia counts as learned


@inline
def start(belief, work, gyro, tachometer):
    """First mean and covariance: the prior on theta, and M0 = J omega + a of the first reading."""
    start_theta(belief)
    p = belief.prior_theta.shape[0]
    gating.begin(belief, gyro, tachometer)
    calibration.start(belief)
    store(belief.wheel_input, calibration.wheel_input(belief, tachometer))
    if belief.adaptation.on != 0:
        adaptation.start(belief)
    for i in range(3):
        belief.covariance[3 + p + i, 3 + p + i] = belief.prior_torque_std**2
    _start_momentum(belief, work, gyro)


@outline
def _start_momentum(belief, work, gyro):
    """M = J omega + a of one reading, with what is known of theta and with nothing of M before."""
    p, size = belief.prior_theta.shape[0], belief.mean.shape[0]
    omega, a = calibration.corrected(belief, gyro), load(belief.wheel_input)
    inertia = estimated_inertia(belief)
    store(belief.mean, add(multiply(inertia, omega), a))
    store(belief.reference_rate, omega)
    covariance, rows, identity = belief.covariance, work.rows, work.jacobian[0]
    store_symmetric(identity, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    write_times_regressor(identity, omega, work.regressor)
    for i in range(3):
        for j in range(size):
            rows[i, j] = 0.0
        for k in range(p):
            rows[i, 3 + k] = work.regressor[i, k]
    calibration.write_start_rows(belief, omega, rows)
    s2 = belief.gyro_std**2
    noise = congruence(inertia, (s2, s2, s2, 0.0, 0.0, 0.0))
    moment = work.jacobian[1]
    store_symmetric(moment, axpy_symmetric(1.0, noise, load_symmetric(belief.wheel_momentum_covariance)))
    for i in range(3):
        for j in range(3, size):
            total = 0.0
            for k in range(3, size):
                total += rows[i, k] * covariance[k, j]
            covariance[i, j] = covariance[j, i] = total
    for i in range(3):
        for j in range(i, 3):
            total = moment[i, j]
            for k in range(3, size):
                total += covariance[i, k] * rows[j, k]
            covariance[i, j] = covariance[j, i] = total


@outline
def predict(belief, work, tachometer, dt):
    """Move the belief from the last reading to this one, dt seconds later."""
    p = belief.prior_theta.shape[0]
    J_inv = inverse(estimated_inertia(belief))
    calibration.begin_prediction(belief)
    if belief.gate.threshold > 0.0:
        gating.gate_tachometers(belief, tachometer, work.torque, dt)
    else:
        for k in range(tachometer.shape[0]):
            belief.speed[k] = tachometer[k]
    after = calibration.wheel_input(belief, belief.speed)
    if belief.adaptation.on != 0:
        adaptation.predict(belief, dt)
    before = load(belief.wheel_input)
    per_step = 1.0 / belief.substeps
    h = dt * per_step
    noise = congruence(J_inv, load_symmetric(belief.wheel_momentum_covariance))
    for step in range(belief.substeps):
        a0 = axpy(step * per_step, subtract(after, before), before)
        a1 = axpy((step + 0.5) * per_step, subtract(after, before), before)
        momentum, tau = load(belief.mean), load(belief.mean[3 + p :])
        omega = multiply(J_inv, subtract(momentum, a0))
        momentum_model.write_slope_jacobian(momentum, omega, J_inv, work, 0)
        middle = axpy(0.5 * h, add(cross(momentum, omega), tau), momentum)
        omega = multiply(J_inv, subtract(middle, a1))
        momentum_model.write_slope_jacobian(middle, omega, J_inv, work, 1)
        store(belief.mean, axpy(h, add(cross(middle, omega), tau), momentum))
        momentum_model.write_transition(work, p, h)
        shares = step * per_step, (step + 0.5) * per_step
        calibration.complete_transition(belief, work, (momentum, middle), J_inv, shares, h)
        propagate(belief, work, h)
        momentum_model.add_tachometer_noise(belief, work, middle, noise, h * dt)
    if belief.gate.threshold > 0.0:
        gating.inflate_momentum(belief, J_inv, dt)
    store(belief.wheel_input, after)


@inline
def momentum(belief):
    """Estimated total momentum M, N m s."""
    return load(belief.mean)


@inline
def disturbance(belief):
    """Estimated disturbance torque tau, N m."""
    return load(belief.mean[3 + belief.prior_theta.shape[0] :])


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
    gated = belief.gate.threshold > 0.0
    if gated and gating.is_repeated(belief, gyro):
        return 0.0
    momentum_model.linearise(belief, work, gyro)
    if gated:
        decision = gating.REINITIALISE
        if not gating.is_momentum_lost(belief):
            decision = gating.validate(belief, work, momentum_model.support(belief))
        if decision > 0.0:
            return decision
        if decision == gating.REINITIALISE:
            _start_momentum(belief, work, gyro)
            belief.coasting = belief.gate.confirmed = belief.gate.rejections = 0
            return 0.0
        if decision == gating.STEPPED and belief.adaptation.on != 0:
            adaptation.count_step(belief.adaptation)
    belief.coasting, belief.gate.confirmed = 0, 1
    before = momentum(belief)
    nis = _update(belief, work, gyro)
    if gated:
        gating.follow_unmeasured_wheels(belief, before)
    return nis


@outline
def _update(belief, work, gyro):
    """Update by the reading, which is linearised about the mean in work."""
    support = momentum_model.support(belief)
    if belief.adaptation.on != 0 and not _is_coarse(belief) and adaptation.has_stepped(belief, work, support):
        adaptation.step(belief)
    if belief.stepped != 0 and is_known_to(belief, _STEP_OVER):
        belief.stepped = 0
    if belief.rate_coordinates != 0 and belief.stepped == 0:
        return _update_rate(belief, work, support)
    if not _is_coarse(belief):
        if belief.adaptation.on == 0:
            return update(belief, work, 3, support)
        adaptation.keep(belief, work)
        nis = update(belief, work, 3, support)
        adaptation.learn(belief, work)
        return nis
    if belief.adaptation.on != 0:
        adaptation.forget(belief.adaptation)
    size, prior_mean, prior = belief.mean.shape[0], work.prior_mean, work.prior_covariance
    _copy(belief.mean, belief.covariance, prior_mean, prior, size)
    nis, constrained_updates = 0.0, belief.constrained_updates
    for iteration in range(_ITERATIONS):
        if iteration > 0:
            momentum_model.linearise(belief, work, gyro)
        for r in range(3):
            for k in range(support):
                work.innovation[r] -= work.rows[r, k] * (prior_mean[k] - belief.mean[k])
        _copy(prior_mean, prior, belief.mean, belief.covariance, size)
        nis = update(belief, work, 3, support)
    belief.constrained_updates = min(belief.constrained_updates, constrained_updates + 1)
    return nis


@inline
def _update_rate(belief, work, support):
    """The same in errors of the rate, in which one linearisation will do.

    Not after a step of the inertia: that changes the rate and leaves M, so what is known there is M.
    """
    adapts = belief.adaptation.on != 0
    if adapts and _is_coarse(belief):
        adaptation.forget(belief.adaptation)
        adapts = False
    if adapts:
        adaptation.keep(belief, work)
    retraction.begin(belief, work)
    nis = update(belief, work, 3, support)
    if adapts:
        adaptation.learn(belief, work)
    retraction.finish(belief, work)
    return nis


@inline
def _is_coarse(belief):
    """Whether a moment is known to no better than 5 %."""
    return not is_known_to(belief, _ITERATE_ABOVE)


@inline
def _copy(mean, covariance, to_mean, to_covariance, size):
    for i in range(size):
        to_mean[i] = mean[i]
        for j in range(size):
            to_covariance[i, j] = covariance[i, j]
