"""External torque: gravity gradient, solar pressure, constant and orbit-periodic torque."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import (
    add,
    axpy,
    cross,
    load,
    multiply,
)
from satid_gym.core.jit import inline
from satid_gym.core.rotation import to_body


@inline
def orbit_phase(plant, t):
    """cos nt and sin nt of the orbit's angle."""
    return np.cos(plant.orbit_rate * t), np.sin(plant.orbit_rate * t)


@inline
def orbit_phases(plant, t, h):
    """`orbit_phase` at t, t + h and t + 2 h."""
    cosine, sine = orbit_phase(plant, t)
    c, s = orbit_phase(plant, h)
    x, y = c * cosine - s * sine, c * sine + s * cosine
    return (cosine, sine), (x, y), (c * x - s * y, c * y + s * x)


@inline
def external_torque(plant, phase, q, inertia):
    """Gravity gradient 3 n^2 r x J r, solar pressure, constant and orbit-periodic torque, body frame, N m.

    The nadir r is the inertial (cos nt, sin nt, 0) seen from the body; `phase` is (cos nt, sin nt).
    Source: Hughes (1986), ch. 8.
    """
    cosine, sine = phase
    tau = axpy(cosine, load(plant.torque_cosine), load(plant.torque_constant))
    tau = axpy(sine, load(plant.torque_sine), tau)
    tau = add(tau, cross(load(plant.solar_offset), to_body(q, load(plant.solar_force))))
    if plant.gravity_gradient != 0:
        r = to_body(q, (cosine, sine, 0.0))
        tau = axpy(3.0 * plant.orbit_rate**2, cross(r, multiply(inertia, r)), tau)
    return tau
