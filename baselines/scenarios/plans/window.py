"""Plan of the oracle between imaging windows: `swing_between` with settings and sides of each episode and gap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.policies.swing_and_stop import SIDES
from satid_gym.policies.swing_between import SwingBetweenPolicy
from satid_gym.policy import Mission
from satid_gym.vector import SatInertiaIDVectorEnv

_TYPICAL = {"swing": 4.0, "settle": 3.0}
_SCALES = {"swing": 1.0, "settle": 0.4}  # of the logarithm of a setting
_GAPS = 9  # with sides of their own, of an episode's


class WindowPlan(SwingBetweenPolicy):
    """`swing_between` with settings of its own for each episode, those of the oracle's search.

    Args:
        points: (N, 74) where the search looks: logarithms of settings over typical ones, and of how much each side to
            swing to is preferred in each gap.
    """

    size = len(_TYPICAL) + _GAPS * len(SIDES)

    def __init__(self, points: np.ndarray) -> None:
        super().__init__()
        for k, (name, typical) in enumerate(_TYPICAL.items()):
            setattr(self, name, typical * np.exp(_SCALES[name] * points[:, k]))
        self._given_preference = points[:, len(_TYPICAL) :].reshape(-1, _GAPS, len(SIDES))

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare, each episode with its own preference of sides."""
        super().reset(mission, seeds)
        self._preference = self._given_preference

    def told(self, env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
        """What it observes: it flies the true episode again and again, and is told no more."""
        return observation
