"""Tours of the rate envelope's corners that reverse the axes which have waited longest; see `control.corners.tour`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.corners.tour import CornerTour
from satid_gym.control.corners.turn_gain import HOLD
from satid_gym.policy import Kind, Mission


class CornerTourPolicy:
    """Tours the corners of the rate envelope that tanks leave open; for control "rate".

    The default hold is the best for microsat in scenario "slosh" on tuning seeds; another satellite may want another.
    Panels ring while the rates settle, which the forecast does not follow: `ShapedSquarePolicy` is the law for them.

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
    _features: tuple[str, ...] = ()

    def __init__(self, hold: float = HOLD, share: float = 0.9, caution: float = 1.0, margin: float = 3.5) -> None:
        self.hold = check_number("hold", hold, strict=True)
        self.share = check_number("share", share, high=1.0, strict=True)
        self.caution = check_number("caution", caution)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or the satellite has modes that are not observed.
        """
        self._tour = CornerTour([mission], self.margin, self.hold, self.share, self.caution, self._features)
        self._tour.begin(len(seeds))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        return self._tour(observation)
