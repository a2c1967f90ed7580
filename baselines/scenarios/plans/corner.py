"""Plan of the oracle where a tank sloshes: `corner_tour`, told the true mode, that prefers corners of its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baselines.scenarios.plans.shaped import with_true_modes
from satid_gym.control.corners.tour import CORNERS
from satid_gym.policies.corner_tour import CornerTourPolicy
from satid_gym.policy import Mission
from satid_gym.vector import SatInertiaIDVectorEnv

_LEGS = 60  # from corner to corner, with preferences of their own, of the 90 to 160 that an episode has
_WEIGHT = 0.5  # of a preference, in waits over the hold


class CornerPlan(CornerTourPolicy):
    """`corner_tour` with preferences of its own for each leg of each episode, those of the oracle's search.

    Args:
        points: (N, 480) where the search looks: how much each corner is preferred in each of the first 60 legs; later
            legs have the preferences of the last of these.
    """

    size = _LEGS * len(CORNERS)
    _features = ("waited",)

    def __init__(self, points: np.ndarray) -> None:
        super().__init__(caution=0.0)
        self._preference = _WEIGHT * points.reshape(-1, _LEGS, len(CORNERS))

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare, each episode at its first leg."""
        super().reset(mission, seeds)
        self._leg = np.zeros(len(seeds), int)
        self._begins = True

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        preference = self._preference[np.arange(len(observation)), np.minimum(self._leg, _LEGS - 1)]
        before = self._tour.side
        action = self._tour(observation, lambda features: features[:, :, 0] + preference)
        self._leg += (self._tour.side != before).any(axis=1)
        return action

    def told(self, env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
        """What it observes, with true modes; the first observation has their data sheet, which it notes."""
        if self._begins:
            self._begins = False
            return observation
        return with_true_modes(env, observation)
