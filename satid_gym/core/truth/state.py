"""Integrated state of the truth: angular momentum M (3) and attitude q (4), as a tuple of tuples (M, q).

Oscillators, of which a satellite may have any number, have theirs in arrays: plant.oscillators.stage.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import add, axpy, load, store
from satid_gym.core.jit import inline
from satid_gym.core.truth import oscillators


@inline
def load_state(plant):
    """State at plant.time."""
    q = plant.attitude
    return load(plant.momentum), (q[0], q[1], q[2], q[3])


@inline
def store_state(plant, state):
    """Write the state, its quaternion normalised, and that of the oscillators."""
    m, q = state
    oscillators.keep_stage(plant.oscillators)
    store(plant.momentum, m)
    scale = 1.0 / np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for i in range(4):
        plant.attitude[i] = scale * q[i]


@inline
def axpy_state(k, a, b):
    """k a + b."""
    p, q = a[1], b[1]
    return axpy(k, a[0], b[0]), (k * p[0] + q[0], k * p[1] + q[1], k * p[2] + q[2], k * p[3] + q[3])


@inline
def add_state(a, b):
    """a + b."""
    p, q = a[1], b[1]
    return add(a[0], b[0]), (p[0] + q[0], p[1] + q[1], p[2] + q[2], p[3] + q[3])
