"""What a star tracker for slow rates has seen, as a tour of corners weighs it: rests, and turns between readings.

The angle between two readings tells the scale of gyro and wheels about the axes that the body has turned about, the
better the further it has turned. So turns are summed from reading to reading, in the body frame, where each is taken to
be small, and their squares over the flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from satid_gym.policy import Mission
from satid_gym.star_tracker import StarTracker, earth_angle

_READS = 1.0  # decisions since a reading, below which the tracker still reads
_FAR = 0.5  # rad from what blinds it, beyond which it does not matter


class StarsSeen(NamedTuple):
    """Of N episodes.

    Attributes:
        known: (N, 1) whether there was a reading.
        turned: (N, 3) rad over the rate limit, s, since the last reading; 0 before the first.
        squares: (N, 3) s^2, of that between readings so far.
        rested: (N, 1) s that the body has been commanded to rest.
        looked: (N, 1) decisions of it with readings.
        clear: (N, 1) rad from the tracker's exclusions, within half a radian; below 0 it is blind.
    """

    known: np.ndarray
    turned: np.ndarray
    squares: np.ndarray
    rested: np.ndarray
    looked: np.ndarray
    clear: np.ndarray


class StarLog:
    """Notes what the star trackers of a batch of episodes see.

    Args:
        missions: of a scenario with a star tracker; all with the same layout.
    """

    def __init__(self, missions: Sequence[Mission]) -> None:
        first = missions[0]
        tracker = first.satellite.sensors.star_tracker
        assert tracker is not None
        self._layout, self._period = first.layout, first.scenario.decision_period
        self._decisions, self._boresight = first.scenario.decisions, tracker.boresight
        self._exclusions = exclusions(tracker, first.scenario.orbit_rate)
        self.begin(0)

    def begin(self, episodes: int) -> None:
        """Begin that many episodes."""
        self._turned, self._squares = np.zeros((episodes, 3)), np.zeros((episodes, 3))
        self._rested, self._looked = np.zeros((episodes, 1)), np.zeros((episodes, 1))

    def __call__(self, observation: np.ndarray, rests: np.ndarray) -> StarsSeen:
        """What they have seen; `rests` (N,) says whether the body was commanded to rest."""
        seen = {
            name: observation[:, self._layout[name]].astype(float) for name in ("rate", "attitude_age", "time_left")
        }
        gone = (1.0 - seen["time_left"]) * self._decisions
        reads = seen["attitude_age"] < _READS
        known = reads | (seen["attitude_age"] < gone - 0.5)  # it is as old as the flight before the first
        turned = self._turned + self._period * seen["rate"]
        self._squares = self._squares + np.where(reads, turned**2, 0.0)
        self._turned = np.where(reads | ~known, 0.0, turned)
        self._rested = np.where(rests[:, None], self._rested + self._period, 0.0)
        self._looked = np.where(rests[:, None], self._looked + reads, 0.0)
        known = known.astype(float)
        return StarsSeen(known, self._turned, self._squares, self._rested, self._looked, self._clear(observation))

    def _clear(self, observation: np.ndarray) -> np.ndarray:
        clear = np.full((len(observation), 1), _FAR)
        for name, angle in self._exclusions.items():
            towards = observation[:, self._layout[name]].astype(float)
            cosine = towards @ self._boresight / np.maximum(np.linalg.norm(towards, axis=1), np.finfo(float).tiny)
            away = np.arccos(np.clip(cosine, -1.0, 1.0)) - angle
            clear[:, 0] = np.where(towards.any(axis=1), np.minimum(clear[:, 0], away), clear[:, 0])
        return np.maximum(clear, -_FAR)


def exclusions(tracker: StarTracker, orbit_rate: float) -> dict[str, float]:
    """Angle from the boresight, rad, within which "sun" and "earth" blind a tracker, where they do."""
    angles = {}
    if tracker.sun_exclusion is not None:
        angles["sun"] = tracker.sun_exclusion
    if tracker.earth_exclusion is not None:
        angles["earth"] = earth_angle(orbit_rate) + tracker.earth_exclusion
    return angles
