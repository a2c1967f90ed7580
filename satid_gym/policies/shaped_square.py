"""Square waves of body rate whose reversals spare the modes of panels and tanks.

A mode that is excited by an acceleration a of the body swings about eta_0 = -d . a / w^2 with an amplitude A that its
present deflection and rate give,

    A^2 = (eta - eta_0)^2 + (deta/dt / w)^2.

So the rate along d changes in a decision as far as it should, but so that A + |eta_0|, the deflection that then
follows, stays within a share of its limit; where it rings beyond that already, so that the decision damps it most. w is
the filter's estimate less some of its standard deviations, for a mode that is slower bends further. Where reversals
then take long, the periods are as long as they need.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.rate_loop import RateMargin
from satid_gym.core.observation import MODE_PARTS, observed_std
from satid_gym.policy import Kind, Mission

_STAGGER = np.array([0.0, 1.0, 2.0]) / 3.0  # of a period
_PLACES = dict(zip(MODE_PARTS, np.cumsum([0, *MODE_PARTS.values()]).tolist(), strict=False))
_LARGE = 1e6  # cost of what does not spare it
_CHOICES = np.linspace(-1.0, 1.0, 41)  # of the largest acceleration


class ShapedSquarePolicy:
    """Tracks staggered square waves of body rate, as fast as the modes allow; for control "rate".

    Args:
        period: least period of the square wave, s.
        share: of the limit of deflection that is used.
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
        period: float = 24.0,
        share: float = 0.8,
        caution: float = 1.0,
        dwell: float = 0.5,
        amplitude: float = 1.0,
        margin: float = 3.5,
    ) -> None:
        self.period = check_number("period", period, strict=True)
        self.share = check_number("share", share, strict=True)
        self.caution = check_number("caution", caution)
        self.dwell = check_number("dwell", dwell)
        self.amplitude = check_number("amplitude", amplitude, high=1.0, strict=True)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques.
        """
        if mission.control != "rate":
            raise ValueError('shaped_square commands body rates: make the environment with control="rate"')
        self._allowed, self._layout = RateMargin([mission], self.margin), mission.layout
        self._duration = mission.scenario.decision_period
        self._phase = np.tile(0.5 * self._duration / self.period + _STAGGER, (len(seeds), 1))
        self._reference = np.zeros((len(seeds), 3))
        self._nominal: np.ndarray | None = None  # w T (N, modes) of the data sheet: what is seen first

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        modes = observation[:, self._layout["modes"]].astype(float)
        modes = modes.reshape(len(observation), -1, sum(MODE_PARTS.values()))
        if self._nominal is None:
            self._nominal = 2.0 * np.pi * modes[:, :, _PLACES["frequency"]]
        change = self.amplitude * np.where(np.mod(self._phase, 1.0) < 0.5, 1.0, -1.0) - self._reference
        slowest = np.full(change.shape, np.inf)
        for m in range(modes.shape[1]):
            d = modes[:, m, _PLACES["coupling"] : _PLACES["coupling"] + 3]
            direction = d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-12)
            wanted = (direction * change).sum(axis=1)
            given, most = self._spare(modes[:, m], self._nominal[:, m], wanted)
            change += direction * (given - wanted)[:, None]
            slowest = np.minimum(slowest, most[:, None] / np.maximum(np.abs(direction), 1e-9))
        self._reference = np.clip(self._reference + change, -1.0, 1.0)
        period = np.maximum(self.period / self._duration, 4.0 * self.amplitude * (1.0 + self.dwell) / slowest)
        self._phase += 1.0 / period
        return self._allowed(observation, self._reference)

    def _spare(self, mode: np.ndarray, nominal: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Change of the rate along d, (N,) in rate limits, nearest to the wanted one that spares the mode, and the
        largest that does when the mode is at rest; `nominal` is w T of the data sheet."""
        part = {name: mode[:, place] for name, place in _PLACES.items()}
        turned = 2.0 * np.pi * part["frequency"] * np.exp(-self.caution * observed_std(part["frequency_std"]))
        limit = self.share * part["deflection_limit"]
        most = 0.5 * limit * turned**2 / nominal
        choices = np.maximum(2.0 * most, np.abs(wanted))[:, None] * _CHOICES
        centre = -choices * (nominal / turned**2)[:, None]
        state = (part["deflection"] + 1j * part["deflection_rate"] * nominal / turned)[:, None]
        spared = np.abs(state - centre) + np.abs(centre) <= limit[:, None]
        left = np.abs(centre + (state - centre) * np.exp(-1j * turned)[:, None])  # amplitude at rest after the decision
        cost = np.where(spared, np.abs(choices - wanted[:, None]), _LARGE + left)
        best = np.argmin(cost, axis=1)
        return choices[np.arange(len(best)), best], most
