"""Swings between imaging windows, and slews that turn about the boresight as well.

Where the payload points is asked for in windows alone, and how the body is turned about its boresight never. So in the
gap the body swings as fast as it may, about directions in which it has turned least so far, until the way to the next
target takes what is left of the gap; and on that way it turns about the boresight at full rate, which costs no time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.pointing import View
from satid_gym.policies.operator import OperatorPolicy
from satid_gym.policies.swing_and_stop import NONE_YET, SIDES
from satid_gym.policy import Mission


class SwingBetweenPolicy(OperatorPolicy):
    """Excites in the gaps and is on the target when the window opens; for control "rate".

    Defaults are those that the gate of scenario "operations" chose for microsat on tuning seeds.

    Args:
        swing: s that a swing lasts.
        roll: rate about the boresight during slews, over what the envelope leaves.
        amplitude: of the swings, over what the envelope allows.
        settle: s before the opening at which the target is to be held.
        margin: see `RateMargin`.

    Raises:
        ValueError: a setting is out of range.
    """

    name = "swing_between"

    def __init__(
        self,
        swing: float = 4.0,
        roll: float = 1.0,
        amplitude: float = 1.0,
        settle: float = 3.0,
        margin: float = 3.5,
    ) -> None:
        super().__init__(settle, margin)
        self.swing = check_number("swing", swing, strict=True)
        self.roll = check_number("roll", roll, high=1.0)
        self.amplitude = check_number("amplitude", amplitude, high=1.0, strict=True)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or there are no windows.
        """
        super().reset(mission, seeds)
        n, guide = len(seeds), self._pointing
        self._lengths = np.broadcast_to(np.maximum(np.round(np.divide(self.swing, guide.period)), 1.0), n)
        self._preference = np.zeros((n, 1, len(SIDES)))  # of a side in a gap, logarithm
        self._left, self._side = np.zeros(n), np.zeros((n, 3))  # decisions of the swing that are left, and its side
        self._turned = np.tile(NONE_YET * np.eye(3), (n, 1, 1))
        self._gap, self._was_open = np.zeros(n, int), np.zeros(n, bool)
        self._rolls = np.ones(n)

    def _flown(self, observation: np.ndarray, view: View) -> np.ndarray:
        guide, is_open = self._pointing, view.opens <= 0.0
        self._gap += self._was_open & ~is_open
        self._was_open = is_open
        swings = guide.spare_time(view, self.settle, self.roll > 0.0) > 0.0
        for i in np.flatnonzero(swings & (self._left <= 0.0)):
            self._begin(int(i), view)
        self._left = np.where(swings, self._left - 1.0, 0.0)
        slew = guide.rolling_slew(view, self.settle, self.roll * self._rolls)
        return np.where(swings[:, None], self.amplitude * self._side * view.most, slew)

    def _begin(self, i: int, view: View) -> None:
        """Begin a swing of episode i: about what was turned least."""
        guide = self._pointing
        turn = self._lengths[i] * guide.period * guide.limit[0] * view.most[i] * SIDES
        new = np.einsum("ni,ij,nj->n", turn, np.linalg.inv(self._turned[i]), turn)
        preference = self._preference[i, self._gap[i] % self._preference.shape[1]]
        best = int(np.argmax(np.log(new) + preference))
        self._side[i], self._left[i] = SIDES[best], self._lengths[i]
        self._turned[i] += np.outer(turn[best], turn[best])
        self._rolls[i] = np.sign(self._side[i] @ guide.boresight) or 1.0
