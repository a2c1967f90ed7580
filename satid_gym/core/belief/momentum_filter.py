"""MomentumEKF: x = [M, theta, tau, modes, errors], with a = A j Omega from the tachometers a known input.

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
    congruence,
    cross,
    load,
    load_symmetric,
    multiply,
    store,
    subtract,
)
from satid_gym.core.belief import (
    adaptation,
    alignment,
    announcement,
    attitude,
    calibration,
    gating,
    inertia_step,
    mode_prediction,
    modes,
    momentum_model,
    momentum_update,
    rate_noise,
    star_reading,
    unmeasured,
    whiteness,
)
from satid_gym.core.belief.kalman import estimated_inertia, propagate
from satid_gym.core.belief.momentum_start import return_to_data_sheet, start_momentum
from satid_gym.core.jit import inline, outline


@outline
def predict(belief, work, tachometer, dt):
    """Move the belief from the last reading to this one, dt seconds later."""
    p, flexible = belief.prior_theta.shape[0], belief.modes.coupling.shape[0] > 0
    J_inv = momentum_model.inverse_inertia(belief)
    if belief.coasting != 0 and belief.attitude.boresight.shape[0] > 0:
        momentum_model.follow_own_rate(belief, J_inv)
    calibration.begin_prediction(belief)
    gated, holds = belief.gate.threshold > 0.0, False
    if gated:
        gating.gate_tachometers(belief, tachometer, work.torque, dt)
        alignment.take_wheels(belief, belief.gate.speed, work.torque, dt)
        holds = unmeasured.is_any_stuck(belief)
    else:
        alignment.take_wheels(belief, tachometer, work.torque, dt)
    after = calibration.wheel_input(belief, belief.speed)
    if belief.adaptation.on != 0:
        adaptation.predict(belief, dt)
        inertia_step.follow(belief.adaptation, multiply(J_inv, momentum_model.body_momentum(belief)), dt)
    before = load(belief.wheel_input)
    store(belief.alignment.input_change, subtract(after, before))
    per_step = 1.0 / belief.substeps
    h = dt * per_step
    noise = congruence(J_inv, load_symmetric(belief.wheel_momentum_covariance))
    turns = belief.attitude.boresight.shape[0] > 0 and belief.attitude.known != 0
    offset = attitude.reference(belief, J_inv) if turns else (0.0, 0.0, 0.0)
    if flexible:
        momentum = load(belief.mean)
        mode_prediction.predict(belief, work, estimated_inertia(belief), (before, after), turns, offset, dt)
        if turns:
            attitude.propagate(belief, work)
        propagate(belief, work, dt)
        if belief.alignment.noise_taps == 0:
            rate_noise.add(belief, work, momentum, noise, dt * dt)
        mode_prediction.add_nonlinearity(belief, dt)
    else:
        for step in range(belief.substeps):
            a0 = axpy(step * per_step, subtract(after, before), before)
            a1 = axpy((step + 0.5) * per_step, subtract(after, before), before)
            momentum, tau = load(belief.mean), load(belief.mean[3 + p :])
            omega = multiply(J_inv, subtract(momentum, a0))
            momentum_model.write_slope_jacobian(momentum, omega, J_inv, work, 0)
            if holds:
                unmeasured.hold_total(belief, omega, work.jacobian[0])
            middle = axpy(0.5 * h, add(cross(momentum, omega), tau), momentum)
            omega = multiply(J_inv, subtract(middle, a1))
            momentum_model.write_slope_jacobian(middle, omega, J_inv, work, 1)
            if holds:
                unmeasured.hold_total(belief, omega, work.jacobian[1])
            store(belief.mean, axpy(h, add(cross(middle, omega), tau), momentum))
            momentum_model.write_transition(work, p, h)
            shares = step * per_step, (step + 0.5) * per_step
            if turns:
                attitude.predict(belief, work, momentum, (omega, add(omega, offset)), J_inv, shares, h)
            if belief.calibration.prior_covariance.shape[0] > 0:
                calibration.complete_transition(belief, work, (momentum, middle), J_inv, shares, h)
            propagate(belief, work, h)
            if belief.alignment.noise_taps == 0:  # an encoder's adds up to nothing
                rate_noise.add(belief, work, middle, noise, h * dt)
    if belief.attitude.boresight.shape[0] > 0:
        belief.attitude.age += dt
        belief.attitude.span = dt
        star_reading.wait_on(belief)
    if gated:
        unmeasured.inflate_momentum(belief, J_inv, dt)
        gating.doubt_inertia(belief, dt)
    store(belief.wheel_input, after)
    if belief.announced > 0.0:
        announcement.raise_covariance(belief, work)
        if belief.leaves == 0:  # what leaves takes its momentum along: the rate stays
            attitude.doubt(belief, work, announcement.size(belief))


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
    return multiply(momentum_model.inverse_inertia(belief), momentum_model.body_momentum(belief))


@inline
def condition(belief, work, gyro):
    """Update with one gyro reading (3,); returns the normalised innovation squared (3 degrees of freedom).

    While a moment is known to no better than 5 %, the update is iterated (Gauss-Newton on the posterior):
    omega is far from linear in theta there, and what one linearisation leaves is never forgotten. Where errors are
    those of the rate, that is done for readings of which one linearisation is off by more than what it leaves unknown.
    Source: Bell and Cathey, The iterated Kalman filter update as a Gauss-Newton method (1993).
    """
    gated = belief.gate.threshold > 0.0
    momentum_model.linearise(belief, work, gyro)
    if gated:
        decision = gating.REINITIALISE
        if not gating.take_momentum_loss(belief):
            decision = gating.validate(belief, work)
        if decision > 0.0:
            return decision
        if decision != gating.ACCEPTED and belief.attitude.boresight.shape[0] > 0:
            attitude.forget(belief)  # it turned at a rate that was wrong
        if decision == gating.REINITIALISE:
            store(work.innovation, alignment.aligned_gyro(belief, gyro))
            start_momentum(belief, work, work.innovation)
            belief.coasting = belief.gate.confirmed = belief.gate.rejections = 0
            return 0.0
        if decision == gating.STEPPED and belief.adaptation.on != 0:
            inertia_step.take(belief, work, True)
        elif decision == gating.STEPPED:
            gating.inflate(belief, work)
    belief.coasting, belief.gate.confirmed = 0, 1
    before = momentum(belief)
    nis = momentum_update.update_gyro(belief, work, gyro)
    if belief.attitude.boresight.shape[0] > 0:
        attitude.take_up(belief)
    if belief.modes.coupling.shape[0] > 0:
        if modes.have_left_data_sheet(belief) and whiteness.may_begin_again(belief.whiteness):
            return_to_data_sheet(belief)
            whiteness.begin_again(belief)
        modes.refresh(belief)
    if gated:
        unmeasured.follow(belief, before)
    return nis
