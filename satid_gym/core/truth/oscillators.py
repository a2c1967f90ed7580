"""Oscillators: hinged panels and slosh masses, which exchange momentum with the body.

Oscillator i has one coordinate q: the angle of a rigid panel about its hinge, rad, or the travel of a particle along a
direction, m. With x its centre of mass, x' and x'' the derivatives by q, I its inertia about its own centre of mass, s
the hinge axis (0 for a particle), m its mass and S = sum m (x - x at rest) over all of them,

    M - A h = (J + dJ(q) - A j A^T) omega + sum_i a_i dq_i/dt        a_i = m x cross x' + I s - S cross m x' / m_total
    p_i = a_i . omega + sum_j mu_ij dq_j/dt        mu_ij = delta_ij (m x'^2 + s . I s) - m_i m_j x'_i . x'_j / m_total
    dp_i/dt = m u . (omega cross x' + x'' dq/dt) + (w cross s) . I w - k q - c dq/dt

with J the inertia at rest, dJ(q) what deflection adds to it, w = omega + s dq/dt and u the velocity of x against the
satellite's centre of mass. That is Lagrange's equation of the free satellite, nothing linearised: spring and damper
are linear, the motion is not. Total momentum keeps its equation, dM/dt = M x omega + tau, whatever the oscillators do.
Origin is the centre of mass at rest, which oscillators move by S / m_total.
Source: Hughes, Spacecraft Attitude Dynamics (1986), ch. 3.5 and 3.6, in momentum form; for slosh as a mass on a spring,
Dodge, The New Dynamic Behavior of Liquids in Moving Containers (2000), ch. 3.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    cross,
    dot,
    inverse,
    load,
    load_symmetric,
    multiply,
)
from satid_gym.core.jit import inline, outline
from satid_gym.core.truth.oscillator_geometry import shift_of, write_mass_matrix

SHARE_LEFT_MIN = 0.01  # of the inertia, that oscillators leave to the body
_ZERO = (0.0, 0.0, 0.0)
_STEP_PHASE_MAX = 0.15  # rad, of the fastest oscillator in one Runge-Kutta step: its frequency is off by 4e-6 then


@inline
def _solve(o, inertia, residual, momentum, speed):
    """omega and, to `speed`, the rates dq/dt of the momenta; `inertia` is J + dJ - A j A^T, `residual` M - A h."""
    count = momentum.shape[0]
    for i in range(count):
        for j in range(count):
            share = -o.mass_inverse[i, j]
            x, y, z = load(o.coupling[i])
            a, b, c = load(o.coupling[j])
            inertia = axpy_symmetric(share, (x * a, y * b, z * c, x * b, x * c, y * c), inertia)
            residual = axpy(share * momentum[j], (x, y, z), residual)
    omega = multiply(inverse(inertia), residual)
    for i in range(count):
        speed[i] = 0.0
        for j in range(count):
            speed[i] += o.mass_inverse[i, j] * (momentum[j] - dot(load(o.coupling[j]), omega))
    return omega


@outline
def rate_at(o, inertia, residual, deflection, momentum):
    """omega of deflections and momenta (c,), and their rates to o.speed; `inertia` is J - A j A^T."""
    change = write_mass_matrix(o, deflection)
    return _solve(o, axpy_symmetric(1.0, change, inertia), residual, momentum, o.speed)


@outline
def write_slope(o, stage, inertia, residual):
    """omega at o.stage, and the derivatives of deflections and momenta to o.slopes[stage]."""
    q, p = o.stage[0], o.stage[1]
    rates, forces = o.slopes[stage][0], o.slopes[stage][1]
    change = write_mass_matrix(o, q)
    omega = _solve(o, axpy_symmetric(1.0, change, inertia), residual, p, rates)
    shift, drift = _ZERO, _ZERO
    for i in range(q.shape[0]):
        shift = add(shift, shift_of(o, i))
        drift = axpy(o.mass[i] * rates[i], load(o.tangent[i]), drift)
    centre = add(cross(omega, shift), drift)  # m_total times the velocity of the centre of mass
    for i in range(q.shape[0]):
        tangent, axis = load(o.tangent[i]), load(o.direction[i])
        velocity = axpy(rates[i], tangent, cross(omega, load(o.place[i])))
        velocity = axpy(-1.0 / o.total_mass, centre, velocity)
        turning = axpy(rates[i], load(o.curvature[i]), cross(omega, tangent))
        own = axpy(o.hinged[i] * rates[i], axis, omega)
        gyric = o.hinged[i] * dot(cross(own, axis), multiply(load_symmetric(o.turned[i]), own))
        forces[i] = o.mass[i] * dot(velocity, turning) + gyric - o.stiffness[i] * q[i] - o.damping[i] * rates[i]
    return omega


@inline
def begin_stage(o, h, slope):
    """o.stage: the state moved on by h seconds of the derivatives in o.slopes[slope]."""
    for i in range(o.deflection.shape[0]):
        o.stage[0, i] = o.deflection[i] + h * o.slopes[slope, 0, i]
        o.stage[1, i] = o.momentum[i] + h * o.slopes[slope, 1, i]


@inline
def end_step(o, h):
    """o.stage: the state after a Runge-Kutta step of h seconds."""
    for i in range(o.deflection.shape[0]):
        for s in range(2):
            k = o.slopes[0, s, i] + 2.0 * (o.slopes[1, s, i] + o.slopes[2, s, i]) + o.slopes[3, s, i]
            o.stage[s, i] = (o.deflection[i] if s == 0 else o.momentum[i]) + h / 6.0 * k


@inline
def keep_stage(o):
    """Take o.stage as the state."""
    for i in range(o.deflection.shape[0]):
        o.deflection[i] = o.stage[0, i]
        o.momentum[i] = o.stage[1, i]


@outline
def start(o, inertia, omega):
    """Write the momenta of deflections and rates when the body turns with omega; what they add to M."""
    change = write_mass_matrix(o, o.deflection)
    total = multiply(change, omega)
    for i in range(o.deflection.shape[0]):
        o.momentum[i] = dot(load(o.coupling[i]), omega)
        for j in range(o.deflection.shape[0]):
            o.momentum[i] += o.mass_matrix[i, j] * o.speed[j]
        total = axpy(o.speed[i], load(o.coupling[i]), total)
    o.fastest = _fastest(o, inertia)
    return total


@inline
def _fastest(o, inertia):
    """Frequency of the fastest, or somewhat more, rad/s: a body that gives way makes all of them faster."""
    J_inv = inverse(inertia)
    fastest = share = 0.0
    for i in range(o.deflection.shape[0]):
        a = load(o.coupling[i])
        share += o.mass_inverse[i, i] * dot(a, multiply(J_inv, a))
        fastest = max(fastest, o.mass_inverse[i, i] * o.stiffness[i])
    return np.sqrt(fastest / max(1.0 - share, SHARE_LEFT_MIN))


@inline
def step_turn(o, duration):
    """What `duration` seconds of oscillation count for as an angle of which a step may have half a radian."""
    return duration * o.fastest * 0.5 / _STEP_PHASE_MAX


@outline
def accelerate(o, inertia, residual, push):
    """Angular acceleration; `inertia` is J - A j A^T, `residual` M - A h, `push` dM/dt - A u - dJ/dt omega.

    What moves dJ and a_i meanwhile is left out: it is second order in the deflections, and decides only by how little a
    wheel leaves its speed limit.
    """
    begin_stage(o, 0.0, 0)
    write_slope(o, 0, inertia, residual)
    change = write_mass_matrix(o, o.deflection)
    return _solve(o, axpy_symmetric(1.0, change, inertia), push, o.slopes[0][1], o.stage[0])
