"""Turns of the body between readings of a star tracker, as a tour of corners weighs them.

The angle between two readings tells the scale of gyro and wheels about the axes that the body has turned about, the
better the further it has turned. So turns are summed from reading to reading, in the body frame, where each is taken to
be small, and their squares over the flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from satid_gym.policy import Mission

_READS = 1.0  # decisions since a reading, below which the tracker still reads


class StarsSeen(NamedTuple):
    """Of N episodes.

    Attributes:
        turned: (N, 3) rad over the rate limit, s, since the last reading; 0 before the first.
        squares: (N, 3) s^2, of that between readings so far.
    """

    turned: np.ndarray
    squares: np.ndarray


class StarLog:
    """Notes what the star trackers of a batch of episodes see.

    Args:
        missions: of a scenario with a star tracker; all with the same layout.
    """

    def __init__(self, missions: Sequence[Mission]) -> None:
        self._layout, self._period = missions[0].layout, missions[0].scenario.decision_period
        self.begin(0)

    def begin(self, episodes: int) -> None:
        """Begin that many episodes."""
        self._known = np.zeros((episodes, 1), bool)
        self._turned, self._squares = np.zeros((episodes, 3)), np.zeros((episodes, 3))

    def __call__(self, observation: np.ndarray) -> StarsSeen:
        """What they have seen with this decision's observations (N, size)."""
        age, rate = (observation[:, self._layout[name]].astype(float) for name in ("attitude_age", "rate"))
        reads = (age < _READS) & (observation[:, self._layout["time_left"]] < 1.0)  # no age at the start
        turned = np.where(self._known, self._turned + self._period * rate, 0.0)
        self._squares = self._squares + np.where(reads, turned**2, 0.0)
        self._turned, self._known = np.where(reads, 0.0, turned), self._known | reads
        return StarsSeen(self._turned, self._squares)
