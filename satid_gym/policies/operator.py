"""Operator: turns the payload to each target in time and holds it there, without exciting the inertia on purpose.

It turns no faster than it must, and so learns from the slews alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.pointing import Pointing, View
from satid_gym.policy import Kind, Mission


class OperatorPolicy:
    """Slews to targets; for control "rate" and scenarios with operations.

    Args:
        settle: s before the opening at which the target is to be held.
        margin: see `RateMargin`.

    Raises:
        ValueError: a setting is out of range.
    """

    name = "operator"
    kind: Kind = "closed_loop"
    observation = "body"

    def __init__(self, settle: float = 3.0, margin: float = 3.5) -> None:
        self.settle = check_number("settle", settle)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or there are no windows.
        """
        self._pointing = Pointing([mission], self.margin, self.name)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        guide = self._pointing
        view = guide.view(observation)
        return guide.clear_of_sun(view, self._flown(observation, view))

    def _flown(self, observation: np.ndarray, view: View) -> np.ndarray:
        """Action (N, 3), but for the Sun."""
        guide, fastest = self._pointing, self._pointing.fastest(view)
        share = guide.duration(view) / np.maximum(view.opens - self.settle, 1e-9)
        return guide.slew(view, np.where(view.opens > self.settle, np.minimum(share, 1.0), 1.0) * fastest)
