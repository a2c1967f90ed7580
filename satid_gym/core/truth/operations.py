"""Operations: the imaging windows of an episode, and whether the payload keeps what they ask.

Windows are drawn one after the other by a stream of their own, which is drawn at the start: so they are the same
whatever is flown. The next one is drawn when the last has closed. All of it acts where `plant.operations.on` is not 0;
else nothing is drawn.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import add, axpy, dot, load, norm, store
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import between, next_word, normal
from satid_gym.core.records import FLOAT, INT, UINT
from satid_gym.core.rotation import to_inertial
from satid_gym.core.sky import is_off_target
from satid_gym.core.truth.star_tracker import place_sun

_DRAWS_MAX = 1000


@functools.cache
def operations_dtype() -> np.dtype:
    """Operations: what is asked, the window that is open or comes next, and the stream that draws them."""
    return np.dtype(
        [
            ("on", INT),  # 0: there are none
            ("boresight", FLOAT, 3),  # unit vector, body frame
            ("gap", FLOAT, 2),  # s, low and high
            ("window", FLOAT, 2),
            ("slew", FLOAT, 2),  # rad over a second of the gap
            ("slew_max", FLOAT),  # rad
            ("pointing_cosine", FLOAT),
            ("steadiness", FLOAT),  # rad/s
            ("keep_out_cosine", FLOAT),  # of the angle between boresight and Sun
            ("clear_cosine", FLOAT),  # likewise of a target
            ("stream", UINT, 4),
            ("opens", FLOAT),  # s, of the window that is open or comes next
            ("closes", FLOAT),
            ("target", FLOAT, 3),  # unit vector, inertial frame
        ],
        align=True,
    )


@inline
def _direction(stream):
    """Unit vector, uniform on the sphere."""
    v = normal(stream), normal(stream), normal(stream)
    k = 1.0 / norm(v)
    return k * v[0], k * v[1], k * v[2]


@outline
def begin_operations(plant):
    """Draw the Sun, with the payload's boresight clear of it, and the first window."""
    own, stream = plant.operations, plant.stream
    for i in range(4):
        own.stream[i] = next_word(stream)
    boresight = to_inertial(plant.attitude, load(own.boresight))
    sun = _direction(own.stream)
    while dot(boresight, sun) >= own.clear_cosine:
        sun = _direction(own.stream)
    place_sun(plant, sun)
    store(own.target, boresight)
    own.closes = plant.time
    next_window(plant)


@outline
def next_window(plant):
    """Draw the window after the present one; its target is the same again where 1000 draws gave none clear of the Sun.

    The middle of the shortest way is clear of it too, so that a way round it is not much longer.
    """
    own, last, sun = plant.operations, load(plant.operations.target), load(plant.tracker.sun)
    gap = between(own.stream, own.gap[0], own.gap[1])
    own.opens = own.closes + gap
    own.closes = own.opens + between(own.stream, own.window[0], own.window[1])
    angle = min(gap * between(own.stream, own.slew[0], own.slew[1]), own.slew_max)
    for _ in range(_DRAWS_MAX):
        v = _direction(own.stream)
        across = axpy(-dot(v, last), last, v)
        k = np.sin(angle) / norm(across)
        target = axpy(k, across, axpy(np.cos(angle), last, (0.0, 0.0, 0.0)))
        middle = add(target, last)
        if dot(target, sun) < own.clear_cosine and dot(middle, sun) < own.clear_cosine * norm(middle):
            store(own.target, target)
            break


@outline
def note_operations(plant, report):
    """Tally whether an open window is missed and whether the payload is within its keep-out; draw the next window."""
    own = plant.operations
    boresight = to_inertial(plant.attitude, load(own.boresight))
    if dot(boresight, load(plant.tracker.sun)) > own.keep_out_cosine:
        report.in_keep_out += 1.0
    off = is_off_target(boresight, load(own.target), load(plant.rate), own.pointing_cosine, own.steadiness)
    if off and plant.time >= own.opens:
        report.window_missed += 1.0
    if plant.time >= own.closes:
        next_window(plant)
