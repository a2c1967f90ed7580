"""Ways to corners that keep wheels out of the band of speed that operators avoid, and what the others cost.

The total momentum M is known in the body frame. A body that turns at the rate omega leaves the wheels M - J omega. The
null motion shares this among them, and leads them to where there is more room (`satid_gym.core.control.null_motion`);
and while the body turns, M turns the other way in its frame. So it can be told which wheels a corner brings into the
band, now and some seconds on.

Each corner is offered twice: *across*, as far out as no wheel is in the band there, whatever is crossed on the way; and
*within*, as far out as no wheel comes into the band on the way either. Where no size of it is clear, the clearest is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from satid_gym.control.corners.turn_gain import HOLD
from satid_gym.control.craft import Craft
from satid_gym.control.decoded_observation import observed_inertia
from satid_gym.core.algebra import axpy, dot, load, subtract
from satid_gym.core.control.allocation import allocate
from satid_gym.core.control.null_motion import AWAY, choose, null_dtype
from satid_gym.core.jit import inline, kernel, outline
from satid_gym.core.rotation import to_body, turn
from satid_gym.policy import Mission
from satid_gym.tracking import write_null_motion

_SIZES = 20  # of a corner that are tried, evenly from 1 to almost 0
_LOOKS = 12  # on the way to a corner
_LOOKS_AHEAD = 4  # at a corner, from the start to the end of the hold
_ROOM = 0.2  # of the band's edges, that wheels keep from it at a corner
_ZERO = (0.0, 0.0, 0.0)


class BandWays(NamedTuple):
    """Ways of N episodes to 16 corners: eight across the band, then the same within.

    Attributes:
        corners: (N, 16, 3) rates over the limit.
        crossing: (N, 16) s that a wheel is in the band on the way.
        stay: (N, 16) share of the next seconds at the corner that a wheel is in the band, or almost.
    """

    corners: np.ndarray
    crossing: np.ndarray
    stay: np.ndarray


class WheelBand:
    """Finds ways for a batch of episodes.

    Args:
        missions: of satellites whose wheels avoid a band of speed; all with the same layout and number of wheels.

    Raises:
        ValueError: the wheels' null momentum is not observed, for they avoid no band, or there are modes.
    """

    def __init__(self, missions: Sequence[Mission]) -> None:
        self._layout, self._period = missions[0].layout, missions[0].scenario.decision_period
        if "null_momentum" not in self._layout:
            raise ValueError(
                "features of a band of wheel speed are chosen but the wheels' null momentum is not observed: take a "
                'scenario with such a band, such as "wheels4", or more than three wheels with avoided_speed'
            )
        if missions[0].satellite.modes:
            raise ValueError(
                "a tour spares panels and tanks or keeps wheels out of a band, not both yet: take a policy without "
                "features of the band, or a satellite without panels and tanks"
            )
        wheels = [mission.satellite.wheels for mission in missions]
        self._all_null = np.zeros(len(missions), null_dtype(wheels[0].count))
        for row, mission in zip(self._all_null, missions, strict=True):
            write_null_motion(row, mission.satellite, mission.prior.inertia)
        self._all_allocation = np.array([np.linalg.pinv(w.axes) for w in wheels])
        self._all_limit = np.array([w.max_momentum for w in wheels])
        self._all_crafts = Craft.of(missions)
        self.assign(np.zeros(1, int))

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._craft, self._null = self._all_crafts.take(rows), self._all_null[rows]
        self._allocation, self._limit = self._all_allocation[rows], self._all_limit[rows]

    def __call__(self, observation: np.ndarray, corners: np.ndarray) -> BandWays:
        """Ways from where episodes are by their observations (N, size) to full corners (N, 8, 3), over the limit."""
        rate, stored, inertia, authority, null = (
            observation[:, self._layout[name]].astype(float)
            for name in ("rate", "wheel_momentum", "inertia", "control_authority", "null_momentum")
        )
        craft, count = self._craft, len(rate)
        tensor = observed_inertia(inertia, craft.inertia)
        limit = craft.rate_limit[:, None]
        row = np.broadcast_to(np.arange(len(self._null)), count)  # the kernel does not look whether a row is there
        bodies = _Bodies(
            self._null[row],
            self._allocation[row],
            self._limit[row],
            tensor,
            craft.stored(tensor, rate, stored),
            null[:, 0],
        )
        ways = len(corners[0]) * 2
        size, crossing, stay = (np.empty((count, ways)) for _ in range(3))
        rates = corners * limit[:, None]
        ways_many(bodies, rate * limit, rates, authority * limit / self._period, size, crossing, stay)
        return BandWays(size[:, :, None] * np.tile(corners, (1, 2, 1)), crossing, stay)


class _Bodies(NamedTuple):
    """What is known of the bodies of N episodes.

    Attributes:
        null: (N,) records of their null motion, see `null_dtype`.
        allocation: (N, n, 3) pseudo-inverse of the wheels' axes.
        limit: (N, n) of the wheels' momentum, N m s.
        inertia: (N, 3, 3) kg m^2.
        momentum: (N, 3) total, body frame, N m s.
        held: (N,) the wheels' null momentum, as observed.
    """

    null: np.ndarray
    allocation: np.ndarray
    limit: np.ndarray
    inertia: np.ndarray
    momentum: np.ndarray
    held: np.ndarray


@inline
def _is_inside(allocation, null, z, room, h):
    """Whether a wheel is in the band, widened by a room, where wheels have momentum h, N m s, and null momentum z."""
    for k in range(allocation.shape[0]):
        size = abs(allocate(allocation, h, k) + z * null.direction[k])
        if size < null.avoided[k, 1] * (1.0 + room) and size >= null.avoided[k, 0] * (1.0 - room):
            return True
    return False


@inline
def _left(inertia, m, w):
    """Momentum that is left to the wheels, M - J w."""
    return subtract(m, (dot(load(inertia[0]), w), dot(load(inertia[1]), w), dot(load(inertia[2]), w)))


@outline
def _stay(allocation, inertia, null, z, m, w):
    """Share of the next seconds at the rate w in which a wheel is in the band; z is now, and where it is led."""
    inside = 0
    for i in range(_LOOKS_AHEAD):
        time = HOLD * i / (_LOOKS_AHEAD - 1)
        between = z[1] + (z[0] - z[1]) * math.exp(-time / AWAY)
        left = _left(inertia, to_body(turn(axpy(time, w, _ZERO)), m), w)
        inside += _is_inside(allocation, null, between, _ROOM, left)
    return inside / _LOOKS_AHEAD


@outline
def _crossed(allocation, inertia, null, z, m, start, end):
    """Share of the way from a rate to another on which a wheel is in the band."""
    inside = 0
    for i in range(_LOOKS):
        w = axpy((i + 0.5) / _LOOKS, subtract(end, start), start)
        inside += _is_inside(allocation, null, z, 0.0, _left(inertia, m, w))
    return inside / _LOOKS


@kernel
def ways_many(bodies, rate, corners, pace, size, crossing, stay):
    """Write the size of the corner of each way, from 0 to 1, and what it does to the wheels.

    Rates (N, 3) and corners (N, 8, 3) are in rad/s, `pace` (N, 3), by which a rate changes, in rad/s^2.
    """
    for n in range(rate.shape[0]):
        allocation, inertia, null = bodies.allocation[n], bodies.inertia[n], bodies.null[n]
        m, start = load(bodies.momentum[n]), load(rate[n])
        now = null.held = bodies.held[n] * null.most
        z = now, choose(null, allocation, bodies.limit[n], m)
        for way in range(2 * corners.shape[1]):
            full, is_within = load(corners[n, way % corners.shape[1]]), way >= corners.shape[1]
            least = np.inf
            for k in range(_SIZES):
                share = 1.0 - k / _SIZES
                end = axpy(share, full, _ZERO)
                stays, crosses = _stay(allocation, inertia, null, z, m, end), 0.0
                if is_within:
                    crosses = _crossed(allocation, inertia, null, now, m, start, end)
                if stays + crosses < least:
                    least, size[n, way], stay[n, way] = stays + crosses, share, stays
                if least == 0.0:
                    break
            end = axpy(size[n, way], full, _ZERO)
            slew = 0.0
            for i in range(3):
                slew = max(slew, abs(end[i] - start[i]) / pace[n, i])
            crossing[n, way] = slew * _crossed(allocation, inertia, null, now, m, start, end)
