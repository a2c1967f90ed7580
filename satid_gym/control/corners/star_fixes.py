"""Rotation of the body between the fixes of its star tracker.

The angle between two fixes determines the scale of gyro and wheels about the axes of the rotation, the better the
larger it is. Angles are summed as vectors in the body frame, as if each were small.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.policy import Mission

_RECENT = 1.0  # decisions since a fix, below which there was one in this decision


class StarFixes:
    """Sums of a batch of N episodes.

    Args:
        missions: of a scenario with a star tracker; all with the same layout.

    Attributes:
        turn: (N, 3) rotation since the last fix, over the rate limit, s; 0 before the first.
        squares: (N, 3) sum of the squares of that between fixes, s^2.

    Raises:
        ValueError: no attitude is observed.
    """

    def __init__(self, missions: Sequence[Mission]) -> None:
        self._layout, self._period = missions[0].layout, missions[0].scenario.decision_period
        if "attitude_age" not in self._layout:
            raise ValueError(
                "features of stars are chosen but no star tracker is observed: take a satellite or scenario with one, "
                'such as "calibration", and an estimator that has the attitude'
            )
        self.begin(0)

    def begin(self, episodes: int) -> None:
        """Begin that many episodes."""
        self._fixed = np.zeros((episodes, 1), bool)
        self.turn, self.squares = np.zeros((episodes, 3)), np.zeros((episodes, 3))

    @property
    def memory(self) -> tuple[np.ndarray, ...]:
        """All that is kept of the episodes, arrays of N rows."""
        return self._fixed, self.turn, self.squares

    @memory.setter
    def memory(self, memory: tuple[np.ndarray, ...]) -> None:
        self._fixed, self.turn, self.squares = memory

    def update(self, observation: np.ndarray) -> None:
        """Add this decision's observations (N, size)."""
        age, rate = (observation[:, self._layout[name]].astype(float) for name in ("attitude_age", "rate"))
        fix = (age < _RECENT) & (observation[:, self._layout["time_left"]] < 1.0)  # at the start the age is 0 anyway
        turn = np.where(self._fixed, self.turn + self._period * rate, 0.0)
        self.squares = self.squares + np.where(fix, turn**2, 0.0)
        self.turn, self._fixed = np.where(fix, 0.0, turn), self._fixed | fix
