"""Excitation from corner to corner of the rate envelope, by reversals that panels and tanks allow.

At a corner all three body rates are at their limit, where they tell most of the inertia. Which axes reverse together
decides how far a mode bends: the parts of their changes along its d add up or cancel. And a tank moves so slowly that
it does not follow a rate which soon turns back. So of the corners those are open from which, a decision later, some
corner can be kept for good with every mode inside its limit (`satid_gym.control.observed_modes`); what was found to be
open leaves a way to go on. Of these the law takes the one that reverses the axes which have waited longest.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.observed_modes import ObservedModes
from satid_gym.control.rate_loop import RateMargin
from satid_gym.policy import Kind, Mission

_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_FIRST_WAITS = np.array([1.0, 2.0 / 3.0, 1.0 / 3.0])  # of the hold, so that the axes do not begin together
_CLOSED = 1e6  # what a closed corner loses by its peak: where none is open, the one that bends least is taken


class CornerTourPolicy:
    """Tours the corners of the rate envelope that the modes leave open; for control "rate".

    Args:
        hold: least time between two reversals of an axis, s.
        share, caution: see `ObservedModes`.
        margin: see `RateMargin`.

    Raises:
        ValueError: a setting is out of range.
    """

    name = "corner_tour"
    kind: Kind = "closed_loop"
    observation = "body"

    def __init__(self, hold: float = 7.0, share: float = 0.9, caution: float = 1.0, margin: float = 3.5) -> None:
        self.hold = check_number("hold", hold, strict=True)
        self.share = check_number("share", share, high=1.0, strict=True)
        self.caution = check_number("caution", caution)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or the satellite has modes that are not observed.
        """
        self._modes = ObservedModes([mission], self.share, self.caution)
        self._allowed, self._duration = RateMargin([mission], self.margin), mission.scenario.decision_period
        self._side = np.ones((len(seeds), 3))
        self._waited = np.tile(self.hold * _FIRST_WAITS, (len(seeds), 1))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        corners = _CORNERS * self._allowed(observation, np.ones(3))[:, None]
        corners = np.broadcast_to(corners, (len(observation), *_CORNERS.shape))
        peak = self._modes.peaks_of_turns(self._modes.read(observation), corners)
        reverses = self._side[:, None] != _CORNERS
        worth = np.where(self._waited >= self.hold, self._waited / self.hold, -1.0)
        total = np.where(peak <= 1.0, (reverses * worth[:, None]).sum(axis=2), -_CLOSED * peak)
        episodes, best = np.arange(len(observation)), np.argmax(total, axis=1)
        self._side = _CORNERS[best]
        self._waited = np.where(reverses[episodes, best], 0.0, self._waited) + self._duration
        return corners[episodes, best]
