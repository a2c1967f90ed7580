"""Draw of the oscillators of an episode about the data sheet's."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import (
    add,
    axpy_symmetric,
    cross,
    dot,
    is_physical,
    load,
    load_symmetric,
    multiply,
    store,
)
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import normal
from satid_gym.core.truth.oscillator_geometry import point_inertia


@inline
def _held_frequency(o, i):
    """Natural frequency of oscillator i where the body is held, rad/s."""
    tangent = cross(load(o.direction[i]), load(o.arm[i])) if o.hinged[i] > 0.0 else load(o.direction[i])
    axis = load(o.direction[i])
    own = o.hinged[i] * dot(axis, multiply(load_symmetric(o.inertia[i]), axis))
    return np.sqrt(o.stiffness[i] / (o.mass[i] * dot(tangent, tangent) + own))


@outline
def fits(o, inertia):
    """Whether the body without oscillators of the drawn scale is a rigid one; `inertia` is J."""
    left = o.total_mass
    for i in range(o.mass.shape[0]):
        m = o.scale[i, 0] * o.mass[i]
        left -= m
        inertia = axpy_symmetric(-o.scale[i, 0], load_symmetric(o.inertia[i]), inertia)
        inertia = axpy_symmetric(-1.0, point_inertia(m, add(load(o.rest[i]), load(o.arm[i]))), inertia)
    return left > 0.0 and is_physical(inertia)


@outline
def _take_scale(o):
    """Multiply by the drawn scale; spring and damper follow, so that frequency and damping ratio become as drawn."""
    for i in range(o.mass.shape[0]):
        mass, frequency, damping = load(o.scale[i])
        o.mass[i] *= mass
        o.stiffness[i] *= mass * frequency * frequency
        o.damping[i] *= mass * frequency * damping
        for j in range(3):
            for k in range(3):
                o.inertia[i, j, k] *= mass


@inline
def draw_scale(draw, plant):
    """Write by what factors the oscillators are off nominal."""
    stream, o = plant.stream, plant.oscillators
    for i in range(o.mass.shape[0]):
        twin = draw.oscillator_twin[i]
        if twin < i:
            store(o.scale[i], load(o.scale[twin]))
            continue
        o.scale[i, 0] = np.exp(draw.oscillator_mass[i] * normal(stream))
        o.scale[i, 1] = np.exp(draw.oscillator_frequency[i] * normal(stream))
        o.scale[i, 2] = np.exp(draw.oscillator_damping[i] * normal(stream))


@outline
def draw_oscillators(draw, plant):
    """Turn the nominal oscillators into those of the drawn scale, and draw how they begin."""
    stream, o = plant.stream, plant.oscillators
    _take_scale(o)
    for i in range(o.mass.shape[0]):
        if draw.oscillator_deflection[i] > 0.0:
            o.deflection[i] = draw.oscillator_deflection[i] * normal(stream)
            o.speed[i] = _held_frequency(o, i) * draw.oscillator_deflection[i] * normal(stream)
