"""Geometry of oscillators: their record, and at a deflection their places, the mass matrix and what they add to J.

The equations are those of `oscillators`.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    cross,
    dot,
    load,
    load_symmetric,
    multiply,
    store,
    store_symmetric,
    subtract,
)
from satid_gym.core.factors import factor, invert
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT

_ZERO, _ZERO_SYMMETRIC = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@functools.cache
def oscillators_dtype(count: int) -> np.dtype:
    """So many oscillators: what they are made of, their state, and scratch space of the integrator."""
    return np.dtype(
        [
            ("total_mass", FLOAT),  # kg, of the satellite; infinite: its centre of mass stays
            ("mass", FLOAT, count),
            ("rest", FLOAT, (count, 3)),  # a particle's place at rest; a panel's hinge
            ("direction", FLOAT, (count, 3)),  # a particle's; a panel's hinge axis s
            ("arm", FLOAT, (count, 3)),  # from the hinge to the panel's centre of mass; 0 for a particle
            ("inertia", FLOAT, (count, 3, 3)),  # of the panel about its centre of mass, at rest; 0 for a particle
            ("hinged", FLOAT, count),  # 1: a panel
            ("stiffness", FLOAT, count),
            ("damping", FLOAT, count),
            ("fastest", FLOAT),  # rad/s, see `start`
            ("scale", FLOAT, (count, 3)),  # drawn: of mass, frequency and damping ratio
            # state, and the rate that follows from it
            ("deflection", FLOAT, count),
            ("momentum", FLOAT, count),
            ("speed", FLOAT, count),
            # a stage of the Runge-Kutta method: deflection and momentum, and their derivatives at all four
            ("stage", FLOAT, (2, count)),
            ("slopes", FLOAT, (4, 2, count)),
            # at a deflection
            ("place", FLOAT, (count, 3)),
            ("tangent", FLOAT, (count, 3)),
            ("curvature", FLOAT, (count, 3)),
            ("turned", FLOAT, (count, 3, 3)),
            ("coupling", FLOAT, (count, 3)),
            ("mass_matrix", FLOAT, (count, count)),
            ("factors", FLOAT, (count, count)),
            ("mass_inverse", FLOAT, (count, count)),
        ],
        align=True,
    )


@inline
def _turn(axis, angle, v):
    """v turned about a unit axis, by Rodrigues' formula."""
    c, s = np.cos(angle), np.sin(angle)
    return axpy((1.0 - c) * dot(axis, v), axis, axpy(s, cross(axis, v), axpy(c, v, _ZERO)))


@inline
def point_inertia(m, x):
    """m (x^2 1 - x x^T), symmetric."""
    a, b, c = x
    return m * (b * b + c * c), m * (a * a + c * c), m * (a * a + b * b), -m * a * b, -m * a * c, -m * b * c


@inline
def _place(o, i, q):
    """Write place, its derivatives and the turned inertia of oscillator i; what that adds to J."""
    m, rest, axis = o.mass[i], load(o.rest[i]), load(o.direction[i])
    if o.hinged[i] == 0.0:
        x = axpy(q, axis, rest)
        store(o.place[i], x)
        store(o.tangent[i], axis)
        store(o.curvature[i], _ZERO)
        return axpy_symmetric(-1.0, point_inertia(m, rest), point_inertia(m, x))
    first = load(o.arm[i])
    arm = _turn(axis, q, first)
    tangent = cross(axis, arm)
    store(o.place[i], add(rest, arm))
    store(o.tangent[i], tangent)
    store(o.curvature[i], cross(axis, tangent))
    # rows of the rotation are the body's axes as the panel sees them
    own = load_symmetric(o.inertia[i])
    ex, ey, ez = _turn(axis, -q, (1.0, 0.0, 0.0)), _turn(axis, -q, (0.0, 1.0, 0.0)), _turn(axis, -q, (0.0, 0.0, 1.0))
    fx, fy, fz = multiply(own, ex), multiply(own, ey), multiply(own, ez)
    turned = dot(ex, fx), dot(ey, fy), dot(ez, fz), dot(ex, fy), dot(ex, fz), dot(ey, fz)
    store_symmetric(o.turned[i], turned)
    change = axpy_symmetric(-1.0, own, turned)
    change = axpy_symmetric(-1.0, point_inertia(m, add(rest, first)), change)
    return axpy_symmetric(1.0, point_inertia(m, add(rest, arm)), change)


@inline
def shift_of(o, i):
    """m (x - x at rest) of oscillator i."""
    at_rest = add(load(o.rest[i]), load(o.arm[i]))
    return axpy(o.mass[i], subtract(load(o.place[i]), at_rest), _ZERO)


@outline
def write_mass_matrix(o, deflection):
    """Write a_i and mu at the deflections (c,), and return dJ (symmetric)."""
    count, per_mass = deflection.shape[0], 1.0 / o.total_mass
    change, shift = _ZERO_SYMMETRIC, _ZERO
    for i in range(count):
        change = axpy_symmetric(1.0, _place(o, i, deflection[i]), change)
        shift = add(shift, shift_of(o, i))
    for i in range(count):
        m, tangent, axis = o.mass[i], load(o.tangent[i]), load(o.direction[i])
        spin = multiply(load_symmetric(o.turned[i]), axis)
        own = m * dot(tangent, tangent) + o.hinged[i] * dot(axis, spin)
        coupling = axpy(o.hinged[i], spin, cross(axpy(m, load(o.place[i]), _ZERO), tangent))
        store(o.coupling[i], axpy(-m * per_mass, cross(shift, tangent), coupling))
        for j in range(count):
            shared = m * o.mass[j] * per_mass * dot(tangent, load(o.tangent[j]))
            o.mass_matrix[i, j] = (own if i == j else 0.0) - shared
    factor(o.mass_matrix, 0, count, o.factors)
    invert(o.factors, count, o.mass_inverse)
    return axpy_symmetric(-1.0, point_inertia(per_mass, shift), change)
