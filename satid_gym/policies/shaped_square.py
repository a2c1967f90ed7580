"""Square waves of body rate whose reversals hardly excite the modes of panels and tanks.

Reversals are shaped by what is observed of the modes (`satid_gym.control.mode_shaping`): where they then take long, the
periods are as long as they need.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.mode_shaping import shaped
from satid_gym.control.observed_modes import ObservedModes
from satid_gym.control.rate_loop import RateMargin
from satid_gym.policy import Kind, Mission, check_commands_rates

_STAGGER = np.array([0.0, 1.0, 2.0]) / 3.0  # of a period


class ShapedSquarePolicy:
    """Tracks staggered square waves of body rate, as fast as the modes allow; for control "rate".

    Defaults suit microsat in scenario "flex"; `python -m baselines.scenarios.tune` finds those of another satellite.

    Args:
        period: least period of the square wave, s.
        share: of the limit of deflection that is used, at most 1.
        caution: standard deviations that the frequency is taken lower than it is estimated.
        dwell: time at full rate after a reversal, over the time that the reversal takes.
        amplitude: of the rates, over what the envelope allows.
        margin: see `RateMargin`.

    Raises:
        ValueError: a setting is out of range.
    """

    name = "shaped_square"
    kind: Kind = "closed_loop"
    observation = "body"

    def __init__(
        self,
        period: float = 12.0,
        share: float = 0.9,
        caution: float = 1.0,
        dwell: float = 0.5,
        amplitude: float = 1.0,
        margin: float = 3.5,
    ) -> None:
        self.period = check_number("period", period, strict=True)
        self.share = check_number("share", share, high=1.0, strict=True)
        self.caution = check_number("caution", caution)
        self.dwell = check_number("dwell", dwell)
        self.amplitude = check_number("amplitude", amplitude, high=1.0, strict=True)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or the satellite has modes that are not observed.
        """
        check_commands_rates(mission, self.name)
        self._modes = ObservedModes([mission], 1.0, self.caution)
        self._allowed, self._duration = RateMargin([mission], self.margin), mission.scenario.decision_period
        self._phase = np.zeros((len(seeds), 3)) + 0.5 * self._duration / self.period + _STAGGER
        self._reference = np.zeros((len(seeds), 3))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        wave = self.amplitude * np.where(np.mod(self._phase, 1.0) < 0.5, 1.0, -1.0)
        modes, edge = self._modes.read(observation), np.ones(wave.shape)
        rates, slowest = shaped(modes, self._reference, wave[:, None], edge, self.share)
        self._reference = rates[:, 0]
        period = np.maximum(self.period / self._duration, 4.0 * self.amplitude * (1.0 + self.dwell) / slowest)
        self._phase += 1.0 / period
        return self._allowed(observation, self._reference)
