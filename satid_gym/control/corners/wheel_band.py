"""Ways to corners that keep wheels out of the band of speed that operators avoid, and what the others cost.

The total momentum M is known, in the body frame. A body that turns at the rate omega leaves the wheels M - J omega,
which the null motion shares among them (`satid_gym.core.control.null_motion`), and leads to where there is more room;
and while it turns, M turns the other way in the body frame. So it can be told which wheels a corner brings into the band, now and some seconds on.

Each corner is offered twice: *across*, as far out as no wheel is in the band there, whatever is crossed on the way; and
*within*, as far out as no wheel comes into the band on the way either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from satid_gym.core.algebra import load
from satid_gym.core.control.allocation import allocate
from satid_gym.core.control.null_motion import AWAY, choose, null_dtype
from satid_gym.core.jit import inline, kernel, outline
from satid_gym.policy import Mission
from satid_gym.tracking import write_null_motion

_SCALES = 20  # of a corner that are tried, evenly from 1 to 0
_LOOKS = 12  # on the way to a corner
_AHEAD, _LOOKS_AHEAD = 7.0, 4  # s at a corner that are looked ahead, and how often
_ROOM = 0.2  # of the band's upper edge, that wheels keep from it at a corner


class BandWays(NamedTuple):
    """Ways of N episodes to 16 corners: eight across the band, then eight within.

    Attributes:
        corners: (N, 16, 3) rates over those of the full corner's.
        crossing: (N, 16) s that a wheel is in the band on the way.
        stay: (N, 16) share of the next seconds at the corner that a wheel is in the band, or almost.
    """

    corners: np.ndarray
    crossing: np.ndarray
    stay: np.ndarray


class WheelBand:
    """Finds ways for a batch of episodes.

    Args:
        missions: of a scenario with a band; all with the same layout and number of wheels.

    Raises:
        ValueError: wheels have no band.
    """

    def __init__(self, missions: Sequence[Mission]) -> None:
        wheels = [mission.satellite.wheels for mission in missions]
        if any(w.avoided_speed[1] <= w.avoided_speed[0] for w in wheels):
            raise ValueError(
                "features of the wheels' band are chosen but the wheels have none: take a scenario with one, such as "
                '"wheels4", or wheels with avoided_speed'
            )
        self._all_null = np.zeros(len(missions), null_dtype(wheels[0].count))
        for row, mission in zip(self._all_null, missions, strict=True):
            write_null_motion(row, mission.satellite, mission.prior.inertia)
        self._all_sheets = (
            np.array([np.linalg.pinv(w.axes) for w in wheels]),
            np.array([w.max_momentum for w in wheels]),
            np.array([w.inertia[:, None] * w.avoided_speed for w in wheels]),
        )
        self.assign(np.zeros(1, int))

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies."""
        self._null, self._sheets = self._all_null[rows], tuple(part[rows] for part in self._all_sheets)

    def begin(self, episodes: int) -> None:
        """Begin that many episodes."""
        self._null["held"] = 0.0

    def ways(
        self, momentum: np.ndarray, null: np.ndarray, inertia: np.ndarray, rate: np.ndarray, corners: np.ndarray, pace: np.ndarray
    ) -> BandWays:
        """Ways from a rate (N, 3), rad/s, to corners (N, 8, 3), rad/s.

        Args:
            momentum: (N, 3) total, N m s.
            null: (N,) momentum that wheels hold against each other, over the most.
            inertia: (N, 3, 3) kg m^2.
            rate: of the body now.
            corners: at full rates.
            pace: (N, 3) change of the rate in a second, rad/s^2.
        """
        count = len(rate)
        scale, crossing, stay = np.empty((count, 16)), np.empty((count, 16)), np.empty((count, 16))
        ways_many(self._null, self._sheets, momentum, null, inertia, rate, corners, pace, scale, crossing, stay)
        return BandWays(scale[:, :, None] * np.tile(corners, (1, 2, 1)), crossing, stay)


@inline
def _is_inside(allocation, avoided, null, z, room, h):
    """Whether momentum h, body frame, N m s, brings a wheel into the band."""
    for k in range(allocation.shape[0]):
        size = abs(allocate(allocation, h, k) + z * null.direction[k])
        if size < avoided[k, 1] * (1.0 + room) and size >= avoided[k, 0] * (1.0 - room):
            return True
    return False


@inline
def _left(inertia, m, w):
    """M - J omega."""
    return (
        m[0] - (inertia[0, 0] * w[0] + inertia[0, 1] * w[1] + inertia[0, 2] * w[2]),
        m[1] - (inertia[1, 0] * w[0] + inertia[1, 1] * w[1] + inertia[1, 2] * w[2]),
        m[2] - (inertia[2, 0] * w[0] + inertia[2, 1] * w[1] + inertia[2, 2] * w[2]),
    )


@outline
def _stay(allocation, avoided, inertia, null, ways, m, w):
    """Share of the next seconds at the rate w in which a wheel is in the band."""
    speed = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) + 1e-30
    a = (w[0] / speed, w[1] / speed, w[2] / speed)
    along = a[0] * m[0] + a[1] * m[1] + a[2] * m[2]
    cross = (a[1] * m[2] - a[2] * m[1], a[2] * m[0] - a[0] * m[2], a[0] * m[1] - a[1] * m[0])
    inside = 0
    for i in range(_LOOKS_AHEAD):
        time = _AHEAD * i / (_LOOKS_AHEAD - 1)
        z = ways[1] + (ways[0] - ways[1]) * math.exp(-time / AWAY)
        angle = -speed * time
        c, s = math.cos(angle), math.sin(angle)
        b = along * (1.0 - c)
        turned = (
            c * m[0] + s * cross[0] + b * a[0],
            c * m[1] + s * cross[1] + b * a[1],
            c * m[2] + s * cross[2] + b * a[2],
        )
        if _is_inside(allocation, avoided, null, z, _ROOM, _left(inertia, turned, w)):
            inside += 1
    return inside / _LOOKS_AHEAD


@outline
def _crossing(allocation, avoided, inertia, null, z, m, start, end):
    """Share of the way from a rate to another on which a wheel is in the band."""
    inside = 0
    for i in range(_LOOKS):
        x = (i + 0.5) / _LOOKS
        w = (
            start[0] + x * (end[0] - start[0]),
            start[1] + x * (end[1] - start[1]),
            start[2] + x * (end[2] - start[2]),
        )
        if _is_inside(allocation, avoided, null, z, 0.0, _left(inertia, m, w)):
            inside += 1
    return inside / _LOOKS


@kernel
def ways_many(null, sheets, momentum, held, inertia, rate, corners, pace, scale, crossing, stay):
    """Write scales, crossings and stays of each episode and way."""
    for n in range(rate.shape[0]):
        allocation, limit, avoided = sheets[0][n], sheets[1][n], sheets[2][n]
        m, start, row = load(momentum[n]), load(rate[n]), null[n]
        z = row.held = held[n] * row.most
        goal = choose(row, allocation, limit, m)
        for c in range(8):
            for within in range(2):
                way = c + 8 * within
                least = 9.0
                for k in range(_SCALES):
                    share = 1.0 - k / _SCALES
                    end = (share * corners[n, c, 0], share * corners[n, c, 1], share * corners[n, c, 2])
                    waits = _stay(allocation, avoided, inertia[n], row, (z, goal), m, end)
                    crossed = 0.0
                    if within == 1:
                        crossed = _crossing(allocation, avoided, inertia[n], row, z, m, start, end)
                    if waits + crossed < least:
                        least = waits + crossed
                        scale[n, way], stay[n, way] = share, waits
                        if least == 0.0:
                            break
                share = scale[n, way]
                end = (share * corners[n, c, 0], share * corners[n, c, 1], share * corners[n, c, 2])
                slew = 0.0
                for i in range(3):
                    slew = max(slew, abs(end[i] - start[i]) / pace[n, i])
                crossing[n, way] = slew * _crossing(allocation, avoided, inertia[n], row, z, m, start, end)
