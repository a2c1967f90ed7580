"""Gaps between imaging windows: excitation gives way to the slew when the way to the target takes what is left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.pointing import Pointing
from satid_gym.policy import Mission

SETTLE = 4.0  # s before an imaging window opens at which learned tours are on their target


class Gaps:
    """Passes rate commands on while there is time, then turns to the target, for a batch of episodes.

    During the slew the body turns about the boresight as well, in the direction in which the excitation turned it last:
    this excites, and takes no more time.

    Args:
        missions: of a scenario with operations; all with the same layout.
        margin: see `RateMargin`.
        settle: s before the opening at which the target is to be held.
        name: of the policy, for messages.

    Raises:
        ValueError: a number is out of range, actions are torques, or no windows are observed.
    """

    def __init__(self, missions: Sequence[Mission], margin: float, settle: float, name: str) -> None:
        self._pointing = Pointing(missions, margin, name)
        self._settle = check_number("settle", settle)
        self.begin(1)

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._pointing.assign(rows)

    def begin(self, episodes: int) -> None:
        """Begin that many episodes."""
        self._side = np.ones(episodes)

    @property
    def memory(self) -> tuple[np.ndarray, ...]:
        """All that is kept of the episodes, arrays of N rows."""
        return (self._side,)

    @memory.setter
    def memory(self, memory: tuple[np.ndarray, ...]) -> None:
        (self._side,) = memory

    def __call__(
        self, observation: np.ndarray, excitation: np.ndarray, leaves: np.ndarray | bool = False
    ) -> np.ndarray:
        """Action (N, 3) for observations (N, size) and what is flown (N, 3) where there is time for it.

        An episode that `leaves` (N,) begins to slew now, whatever time there is.
        """
        guide = self._pointing
        view = guide.view(observation)
        free = (guide.spare_time(view, self._settle) > 0.0) & ~np.asarray(leaves)
        along = excitation @ guide.boresight
        self._side = np.where(free & (along != 0.0), np.sign(along), self._side)
        slew = guide.rolling_slew(view, self._settle, self._side)
        return guide.clear_of_sun(view, np.where(free[:, None], excitation, slew))
