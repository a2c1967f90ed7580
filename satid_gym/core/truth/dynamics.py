"""Dynamics of a body with reaction wheels, in momentum form; what bends or sloshes is in `oscillators`.

    dM/dt = -omega x M + tau_ext       dh/dt = u       dq/dt = q * omega / 2
    omega = (J - A j A^T)^-1 (M - A h)                 Omega = h / j - A^T omega

Motor torque is internal and does not appear in dM/dt, so momentum is conserved by construction, when a wheel
saturates and when J varies as well. A wheel at its speed limit is locked to the body at that speed: it contributes the
constant j Omega to M and its inertia to the body, which is the same as the motor giving just the torque that holds the
limit.
Source: Hughes, Spacecraft Attitude Dynamics (1986), ch. 6; the locked form follows from it.
"""

from __future__ import annotations

from satid_gym.core.algebra import add, axpy, axpy_symmetric, cross, inverse, load, multiply, store, subtract
from satid_gym.core.jit import inline, outline
from satid_gym.core.truth import oscillators
from satid_gym.core.truth.disturbance import external_torque
from satid_gym.core.truth.inertia_law import inertia_at
from satid_gym.core.wheels import along_axis, sum_wheels, wheel_axis


@inline
def conditions(plant, free, t):
    """Inertia at time t as the derivative takes it: J(t), J - A j A^T and its inverse.

    `free` is A j A^T of the wheels that are not locked (symmetric), kg m^2.
    """
    inertia = inertia_at(plant, t)
    rest = axpy_symmetric(-1.0, free, inertia)
    return inertia, rest, inverse(rest)


@inline
def derivative(plant, at, phase, state, wheels, stage):
    """Derivative (dM/dt, dq/dt) of the state (M, q), and omega; oscillators have theirs in arrays, see `state`.

    Args:
        plant: truth.
        at: `conditions` of the instant.
        phase: of the orbit, see `disturbance.orbit_phase`.
        state: see `satid_gym.core.truth.state`.
        wheels: A h of the wheels, N m s.
        stage: of the Runge-Kutta method, 0 to 3.
    """
    m, q = state
    inertia, rest, J_inv = at
    residual = subtract(m, wheels)
    if plant.oscillators.mass.shape[0] == 0:
        omega = multiply(J_inv, residual)
    else:
        omega = oscillators.write_slope(plant.oscillators, stage, rest, residual)
    torque = external_torque(plant, phase, q, inertia)
    x, y, z = omega
    spin = (
        0.5 * (q[3] * x + q[1] * z - q[2] * y),
        0.5 * (q[3] * y + q[2] * x - q[0] * z),
        0.5 * (q[3] * z + q[0] * y - q[1] * x),
        -0.5 * (q[0] * x + q[1] * y + q[2] * z),
    )
    return (add(cross(m, omega), torque), spin), omega


@inline
def free_wheel_inertia(plant):
    """A j A^T over the wheels that are not locked (symmetric)."""
    s = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(plant.locked.shape[0]):
        if plant.locked[k] == 0:
            x, y, z = wheel_axis(plant.axes, k)
            s = axpy_symmetric(plant.wheel_inertia[k], (x * x, y * y, z * z, x * y, x * z, y * z), s)
    return s


@inline
def sum_free(plant, values):
    """A v over the wheels that are not locked."""
    total = (0.0, 0.0, 0.0)
    for k in range(values.shape[0]):
        if plant.locked[k] == 0:
            total = axpy(values[k], wheel_axis(plant.axes, k), total)
    return total


@outline
def set_speeds(plant):
    """Write rate, wheel speed and rates of the oscillators from the momenta at plant.time."""
    o = plant.oscillators
    residual = subtract(load(plant.momentum), sum_wheels(plant.axes, plant.wheel_momentum))
    rest = axpy_symmetric(-1.0, free_wheel_inertia(plant), inertia_at(plant, plant.time))
    if o.mass.shape[0] == 0:
        omega = multiply(inverse(rest), residual)
    else:
        omega = oscillators.rate_at(o, rest, residual, o.deflection, o.momentum)
    write_speeds(plant, omega)


@inline
def write_speeds(plant, omega):
    """Write rate and wheel speed of the momenta, which make the body turn with omega."""
    store(plant.rate, omega)
    for k in range(plant.locked.shape[0]):
        speed = plant.wheel_momentum[k] / plant.wheel_inertia[k]
        if plant.locked[k] == 0:
            speed -= along_axis(plant.axes, k, omega)
        plant.wheel_speed[k] = speed


@inline
def spin_momentum(plant, k):
    """Absolute spin momentum h = j (Omega + A^T omega) of wheel k, N m s."""
    return plant.wheel_inertia[k] * (plant.wheel_speed[k] + along_axis(plant.axes, k, load(plant.rate)))


@inline
def set_momenta(plant):
    """Write the momenta from rate, wheel speed and the oscillators' motion at plant.time; no wheel is locked."""
    inertia = inertia_at(plant, plant.time)
    momentum = multiply(inertia, load(plant.rate))
    if plant.oscillators.mass.shape[0] > 0:
        momentum = add(momentum, oscillators.start(plant.oscillators, inertia, load(plant.rate)))
    for k in range(plant.locked.shape[0]):
        plant.locked[k] = 0
        plant.wheel_momentum[k] = spin_momentum(plant, k)
        spin = plant.wheel_inertia[k] * plant.wheel_speed[k]
        momentum = axpy(spin, wheel_axis(plant.axes, k), momentum)
    store(plant.momentum, momentum)
