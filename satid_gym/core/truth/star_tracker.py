"""Star tracker: attitude from time to time, where neither the body turns too fast nor Sun or Earth are in its way.

A reading is the true attitude, turned by noise about the axes of the body: of one size about the boresight, of another
about each axis across it. The tracker is blind where the body rate is beyond its limit, where the boresight is within
an angle of the Sun, or within one of the Earth's disc; then, and for as long as it takes to find its stars again, there
is no reading. The Earth is at the inertial (cos nt, sin nt, 0), as the gravity gradient has it. All of it acts where
`plant.tracker.on` is not 0; without exclusion of the Sun none is drawn.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import axpy, dot, load, norm, store
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import normal
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.rotation import load_quaternion, product, store_quaternion, turn
from satid_gym.core.sky import is_blind
from satid_gym.core.truth.disturbance import orbit_phase

SEES_ALL = 2.0  # cosine of an exclusion that excludes nothing
_SAME = 1e-9  # s, within which two instants are one


@functools.cache
def tracker_dtype() -> np.dtype:
    """Star tracker: its data sheet, the sky of the episode, and its state."""
    return np.dtype(
        [
            ("on", INT),  # 0: there is none
            ("every", INT),  # samples between two readings
            ("boresight", FLOAT, 3),  # unit vector, body frame
            ("across_std", FLOAT),  # rad
            ("round_std", FLOAT),
            ("rate_limit", FLOAT),  # rad/s
            ("reacquire", FLOAT),  # s
            ("sun_cosine", FLOAT),  # of the angle between boresight and Sun above which it is blind
            ("earth_cosine", FLOAT),  # likewise of the Earth's centre
            ("sun", FLOAT, 3),  # unit vector, inertial frame
            ("waited", INT),  # samples since the last reading was due
            ("ready", FLOAT),  # s, from which on it tracks
            ("tracks", INT),  # 1: it sees its stars at present
            ("fresh", INT),  # 1: the reading is of this sample
            ("reading", FLOAT, 4),  # attitude, body to inertial, scalar last; not a number without one
        ],
        align=True,
    )


@outline
def begin_tracker(plant):
    """Draw where the Sun is, and track from the start on."""
    tracker = plant.tracker
    tracker.waited, tracker.ready = 0, plant.time
    if tracker.sun_cosine >= SEES_ALL:
        return
    x, y, z = normal(plant.stream), normal(plant.stream), normal(plant.stream)
    k = 1.0 / norm((x, y, z))
    place_sun(plant, (k * x, k * y, k * z))


@inline
def place_sun(plant, sun):
    """Write the direction of the Sun, inertial frame, and the force of its light."""
    store(plant.tracker.sun, sun)
    store(plant.solar_force, axpy(-norm(load(plant.solar_force)), sun, (0.0, 0.0, 0.0)))


@outline
def read_tracker(plant):
    """Write whether the tracker tracks at plant.time, and a reading where one is due."""
    tracker = plant.tracker
    blind = is_blind(tracker, plant.attitude, load(plant.rate), orbit_phase(plant, plant.time))
    if blind:
        tracker.ready = plant.time + tracker.reacquire
    tracker.tracks = 1 if not blind and plant.time >= tracker.ready - _SAME else 0
    tracker.fresh = 1 if tracker.tracks != 0 and tracker.waited == 0 else 0
    tracker.waited = (tracker.waited + 1) % tracker.every
    if tracker.fresh == 0:
        for i in range(4):
            tracker.reading[i] = np.nan
        return
    noise, axis = (normal(plant.stream), normal(plant.stream), normal(plant.stream)), load(tracker.boresight)
    along = dot(noise, axis)
    across = axpy(tracker.across_std, axpy(-along, axis, noise), (0.0, 0.0, 0.0))
    wrong = axpy(tracker.round_std * along, axis, across)
    store_quaternion(tracker.reading, product(load_quaternion(plant.attitude), turn(wrong)))
