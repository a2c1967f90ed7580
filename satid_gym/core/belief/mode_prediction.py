"""Prediction of modes: M, deflections and their momenta moved together, with the derivative of that.

The method is that of Stoermer and Verlet, which neither damps nor drives an oscillation. The derivative follows each
operation (forward mode), so it is that of the step as it is done. The equations are those of `modes`.
Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), ch. I.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import add, axpy, cross, dot, inverse, load, load_symmetric, multiply, store, subtract
from satid_gym.core.belief import attitude, unmeasured
from satid_gym.core.belief.modes import (
    STATES,
    bent_rate,
    body_inertia,
    deflection_rate,
    load_column,
    momentum,
    moving,
)
from satid_gym.core.jit import inline, outline

_PHASE_MAX = 0.2  # rad of an oscillation in a step: frequencies are off by phase^2 / 24
_GROWTH_MAX = 1.0  # 1/s
_FADING = 0.05  # share by which the variance of log w grows in a radian of the oscillation
_STEPS_MAX = 10_000  # a pilot's gap may be long; beyond 2 rad in a step the method is unstable


@outline
def _write_rate_sensitivity(belief, work, omega, J_inv, share):
    """Derivative of omega by the state before the prediction to work.modes.omega, after a share of it.

    That of M is in work.modes.middle.
    """
    p, source, out, rows = belief.prior_theta.shape[0], work.modes.middle, work.modes.omega, work.transition
    x, y, z = omega
    size, first_wheel = belief.mean.shape[0], belief.calibration.wheels
    for i in range(3):  # less L(omega), where J omega = L(omega) theta
        for j in range(size):
            out[i, j] = source[i, j]
        out[i, 3 + i] -= omega[i]
    if p == 6:
        out[0, 6] -= y
        out[1, 6] -= x
        out[0, 7] -= z
        out[2, 7] -= x
        out[1, 8] -= z
        out[2, 8] -= y
    for i in range(belief.modes.coupling.shape[0]):
        at, d = belief.modes.first + STATES * i, load(belief.modes.d[i])
        bent, by_slope = bent_rate(belief, i, belief.mean[at], omega)
        for j in range(size):
            v = axpy(-rows[4 + 2 * i, j], d, axpy(-rows[3 + 2 * i, j], bent, load_column(out, j)))
            out[0, j], out[1, j], out[2, j] = v
        v = axpy(-belief.mean[at], by_slope, load_column(out, at + 3))
        v = axpy(dot(d, omega) - deflection_rate(belief, i, omega), d, v)
        out[0, at + 3], out[1, at + 3], out[2, at + 3] = v
    if first_wheel > 0:
        for k in range(belief.speed.shape[0]):
            before = belief.calibration.speed_before[k]
            for i in range(3):
                out[i, first_wheel + 3 * k + i] -= before + share * (belief.speed[k] - before)
    for j in range(size):
        out[0, j], out[1, j], out[2, j] = multiply(J_inv, load_column(out, j))


@inline
def _kick(belief, work, i, omega, h):
    """Move p of mode i, and its derivative, by h seconds of its spring, its damper and the body's rotation."""
    rows, rates = work.transition, work.modes.omega
    at, d = belief.modes.first + STATES * i, load(belief.modes.d[i])
    w, zeta = belief.modes.w[i], belief.modes.zeta[i]
    eta, speed = belief.mean[at], deflection_rate(belief, i, omega)
    drag, (bent, by_slope) = 2.0 * zeta * w, bent_rate(belief, i, eta, omega)
    curved = dot(omega, multiply(load_symmetric(belief.modes.inertia_curvature[i]), omega))
    for j in range(belief.mean.shape[0]):
        by_speed = rows[4 + 2 * i, j] - (d[0] * rates[0, j] + d[1] * rates[1, j] + d[2] * rates[2, j])
        by_rotation = bent[0] * rates[0, j] + bent[1] * rates[1, j] + bent[2] * rates[2, j]
        rows[4 + 2 * i, j] -= h * ((w * w - curved) * rows[3 + 2 * i, j] + drag * by_speed - by_rotation)
    rows[4 + 2 * i, at + 2] -= h * (2.0 * w * w * eta + drag * speed)
    rotation = 0.5 * dot(omega, bent)
    rows[4 + 2 * i, at + 3] += h * (drag * dot(d, omega) + 0.5 * dot(omega, by_slope))
    rows[4 + 2 * i, at + 4] -= h * drag * speed
    belief.mean[at + 1] -= h * (w * w * eta + drag * speed - rotation)


@inline
def _turn_sensitivity(belief, work, momentum, omega, source, out, h):
    """out = source + h d(M x omega + tau) where `source` (3, size) is the derivative of the M that is moved."""
    first_torque, rates, middle = 3 + belief.prior_theta.shape[0], work.modes.omega, work.modes.middle
    gated = belief.gate.threshold > 0.0
    for j in range(belief.mean.shape[0]):
        by_momentum, by_rate = load_column(middle, j), load_column(rates, j)
        if gated:  # as `unmeasured.hold_total` has it
            by_momentum = subtract(by_momentum, unmeasured.along_axes(belief, by_momentum))
        change = add(cross(by_momentum, omega), cross(momentum, by_rate))
        out[0, j] = source[0, j] + h * change[0]
        out[1, j] = source[1, j] + h * change[1]
        out[2, j] = source[2, j] + h * change[2]
    for i in range(3):
        out[i, first_torque + i] += h


@outline
def predict(belief, work, J, inputs, turns, offset, dt):
    """Move M, eta and p by dt seconds, and write the derivative of that to work.transition, in the order of `moving`.

    Where the attitude is known it turns along, and its derivative is written to work.attitude.

    Args:
        belief: belief.
        work: scratch space.
        J: estimated inertia (symmetric).
        inputs: A j Omega before and after.
        turns: whether the attitude is known.
        offset: its `attitude.reference`.
        dt: s.
    """
    count, size, rows = belief.modes.coupling.shape[0], belief.mean.shape[0], work.transition
    J_inv = inverse(body_inertia(belief, belief.mean, J))
    tau = load(belief.mean[3 + belief.prior_theta.shape[0] :])
    before, after = inputs
    if turns:
        attitude.begin_prediction(work)
    for r in range(3 + 2 * count):
        for j in range(size):
            rows[r, j] = 0.0
        rows[r, moving(belief, r)] = 1.0
    steps = _steps(belief, J_inv, dt)
    h = dt / steps
    for step in range(steps):
        a0 = axpy(step / steps, subtract(after, before), before)
        a1 = axpy((step + 0.5) / steps, subtract(after, before), before)
        M, J_inv = load(belief.mean), inverse(body_inertia(belief, belief.mean, J))
        omega = multiply(J_inv, subtract(subtract(M, a0), momentum(belief)))
        for r in range(3):
            for j in range(size):
                work.modes.middle[r, j] = rows[r, j]
        _write_rate_sensitivity(belief, work, omega, J_inv, step / steps)
        _turn_sensitivity(belief, work, M, omega, rows, work.modes.middle, 0.5 * h)
        for i in range(count):
            _kick(belief, work, i, omega, 0.5 * h)
        middle = axpy(0.5 * h, add(cross(M, omega), tau), M)
        omega = multiply(J_inv, subtract(subtract(middle, a1), momentum(belief)))
        if turns:
            _write_rate_sensitivity(belief, work, add(omega, offset), J_inv, (step + 0.5) / steps)
            attitude.turn_on(belief, work, omega, work.modes.omega, h)
        _write_rate_sensitivity(belief, work, omega, J_inv, (step + 0.5) / steps)
        for i in range(count):
            _drift(belief, work, i, omega, h)
        _turn_sensitivity(belief, work, middle, omega, rows, rows, h)
        store(belief.mean, axpy(h, add(cross(middle, omega), tau), M))
        for i in range(count):
            _kick(belief, work, i, omega, 0.5 * h)


@inline
def _drift(belief, work, i, omega, h):
    """Move eta of mode i, and its derivative, by h seconds."""
    rows, rates = work.transition, work.modes.omega
    at, d = belief.modes.first + STATES * i, load(belief.modes.d[i])
    for j in range(belief.mean.shape[0]):
        by_rate = d[0] * rates[0, j] + d[1] * rates[1, j] + d[2] * rates[2, j]
        rows[3 + 2 * i, j] += h * (rows[4 + 2 * i, j] - by_rate)
    rows[3 + 2 * i, at + 3] -= h * dot(d, omega)
    belief.mean[at] += h * deflection_rate(belief, i, omega)


@inline
def _steps(belief, J_inv, dt):
    """Steps in dt seconds."""
    fastest = 0.0
    for i in range(belief.modes.coupling.shape[0]):
        d = load(belief.modes.d[i])
        fastest = max(fastest, belief.modes.w[i] * np.sqrt(1.0 + dot(d, multiply(J_inv, d))))
    return min(max(belief.substeps, np.int64(np.ceil(fastest * dt / _PHASE_MAX))), _STEPS_MAX)


@outline
def add_nonlinearity(belief, dt):
    """Add to the covariance what the derivative by log w leaves out, of p and of log w itself.

    To second order the spring's force changes by 2 w^2 (deta dlog w + eta (dlog w)^2), whose variance is
    4 w^4 (P_ee P_ww + P_ew^2 + 2 eta^2 P_ww^2); it stays alike for a radian or so of the oscillation before and after,
    so that its power density is 2 / w times that. The first two let the deflection's error feed itself, though an
    oscillation keeps its energy whatever w is: at most at _GROWTH_MAX.

    The derivative of a phase by the frequency holds over a few oscillations. Over many, information would be added up
    at phases that were wrong, and a frequency once settled on would never be left: it fades, up to what the data sheet
    says.
    Source: Gelb, Applied Optimal Estimation (1974), ch. 6.1, the second-order filter, and ch. 8.1, fading memory.
    """
    covariance = belief.covariance
    for i in range(belief.modes.coupling.shape[0]):
        at, w = belief.modes.first + STATES * i, belief.modes.w[i]
        coarse, shared = covariance[at + 2, at + 2], covariance[at, at + 2]
        grown = min(8.0 * w * (covariance[at, at] * coarse + shared**2), _GROWTH_MAX * covariance[at, at])
        covariance[at + 1, at + 1] += w**2 * dt * (grown + 16.0 * w * (belief.mean[at] * coarse) ** 2)
        unknown = max(belief.modes.std[i, 2] ** 2 - coarse, 0.0)
        covariance[at + 2, at + 2] += min(_FADING * w * dt * coarse, unknown)
