"""Square waves of body rate whose reversals hardly excite the modes of panels and tanks.

A mode that is excited by an acceleration a of the body swings about eta_0 = -d . a / w^2 with an amplitude A that its
present deflection and rate give,

    A^2 = (eta - eta_0)^2 + (deta/dt / w)^2.

So the rate along d changes in a decision as far as it should, but so that A + |eta_0|, the deflection that then
follows, stays within a share of its limit; where it rings beyond that already, so that the decision damps it most. w is
the filter's estimate less some of its standard deviations, for a mode that is slower bends further. Where reversals
then take long, the periods are as long as they need. Modes are spared one after another: where there are several that
the same axes excite, only the last is spared for certain.

Deflections are observed over what a step of the rate by its limit rings of the data sheet's mode. The data sheet, w and
|d|, is what the filter believes when a flight begins. A mode of 10 or more cycles a decision is observed as of 10: it
is taken to be slower than it is, which spares it more than it needs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.rate_loop import RateMargin
from satid_gym.core.observation import BOUND, MODE_PARTS, MODE_PLACES, observed_std
from satid_gym.policy import Kind, Mission, check_commands_rates

_STAGGER = np.array([0.0, 1.0, 2.0]) / 3.0  # of a period
_LARGE = 1e6  # cost of what does not spare it
_CHOICES = np.linspace(-1.0, 1.0, 41)  # of the largest change
_TINY = 1e-12  # of a length, so that none is divided by 0
_FARTHEST, _HALVINGS = 100.0, 45  # of a bisection, whose place is then known to some 1e-12
_CHANGE_MAX = 2.0 * np.sqrt(3.0)  # change that is ever wanted along a direction, in rate limits: all three reverse


class ShapedSquarePolicy:
    """Tracks staggered square waves of body rate, as fast as the modes allow; for control "rate".

    Defaults of period, share, dwell and amplitude are those that the gate of scenario "flex" chose for microsat on
    tuning seeds; another satellite may want others.

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
        if mission.observation != "body":
            raise ValueError('shaped_square observes modes: make the environment with observation="body"')
        places = mission.layout["modes"]
        if mission.satellite.oscillators and places.start == places.stop:
            raise ValueError(
                f"the filter estimates no modes: shaped_square cannot spare those of {mission.satellite.name!r}; give "
                'an estimator that has them, such as "momentum"'
            )
        self._allowed, self._layout = RateMargin([mission], self.margin), mission.layout
        self._duration = mission.scenario.decision_period
        self._moments = np.diag(mission.prior.inertia)  # kg m^2, as observed estimates are relative to
        self._phase = np.zeros((len(seeds), 3)) + 0.5 * self._duration / self.period + _STAGGER
        self._reference = np.zeros((len(seeds), 3))
        self._sheet: tuple[np.ndarray, np.ndarray] | None = None  # w T and |d|, (N, modes)

    def note_sheet(self, observation: np.ndarray) -> None:
        """Take the data sheet of each episode's modes from its first observation."""
        modes, coupling = self._modes(observation)
        self._sheet = 2.0 * np.pi * modes[:, :, MODE_PLACES["frequency"]], np.linalg.norm(coupling, axis=2)

    def _modes(self, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is observed of each mode (N, modes, parts), and its d (N, modes, 3), kg^(1/2) m."""
        modes = observation[:, self._layout["modes"]].astype(float)
        modes = modes.reshape(len(observation), -1, sum(MODE_PARTS.values()))
        moments = self._moments * (1.0 + observation[:, self._layout["inertia"]][:, :3])
        by_axis = modes[:, :, MODE_PLACES["coupling"] : MODE_PLACES["coupling"] + 3]
        return modes, by_axis * np.sqrt(np.maximum(moments, 0.0))[:, None]

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        if self._sheet is None:
            self.note_sheet(observation)
        assert self._sheet is not None
        modes, coupling = self._modes(observation)
        size = np.linalg.norm(coupling, axis=2)
        nominal, growth = self._sheet[0], size / np.maximum(self._sheet[1], _TINY)
        change = self.amplitude * np.where(np.mod(self._phase, 1.0) < 0.5, 1.0, -1.0) - self._reference
        slowest = np.full(change.shape, np.inf)
        for m in range(modes.shape[1]):
            direction = coupling[:, m] / np.maximum(size[:, [m]], _TINY)
            wanted = (direction * change).sum(axis=1)
            given, most = self._spare(modes[:, m], nominal[:, m], growth[:, m], wanted)
            change = _turned_to(given, direction, change, -1.0 - self._reference, 1.0 - self._reference)
            slowest = np.minimum(slowest, most[:, None] / np.maximum(np.abs(direction), _TINY))
        self._reference = self._reference + np.clip(change, -1.0 - self._reference, 1.0 - self._reference)
        period = np.maximum(self.period / self._duration, 4.0 * self.amplitude * (1.0 + self.dwell) / slowest)
        self._phase += 1.0 / period
        return self._allowed(observation, self._reference)

    def _spare(
        self, mode: np.ndarray, nominal: np.ndarray, growth: np.ndarray, wanted: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Change of the rate along d, (N,) in rate limits, nearest to the wanted one that spares the mode, and the
        largest that does when the mode is at rest; `nominal` is w T of the data sheet, `growth` |d| over its."""
        part = {name: mode[:, place] for name, place in MODE_PLACES.items()}
        turned = 2.0 * np.pi * part["frequency"] * np.exp(-self.caution * observed_std(part["frequency_std"]))
        given = part["deflection_limit"]  # 0 of a mode that no rotation excites, 10 where there is none
        given = np.where((given > 0.0) & (given < BOUND), given, np.inf)
        bent, limit = np.maximum(growth * nominal / turned**2, _TINY), self.share * given  # |eta_0| by change of rate
        most, reach = np.minimum(0.5 * limit / bent, _CHANGE_MAX), np.minimum(given / bent, _CHANGE_MAX)
        wide = reach[:, None] * _CHOICES  # for what rings beyond its share
        choices = np.column_stack([2.0 * most[:, None] * _CHOICES, wide, np.clip(wanted, -reach, reach)])
        centre = -choices * bent[:, None]
        state = (part["deflection"] + 1j * part["deflection_rate"] * nominal / turned)[:, None]
        spared = np.abs(state - centre) + np.abs(centre) <= limit[:, None]
        left = np.abs(centre + (state - centre) * np.exp(-1j * turned)[:, None])  # amplitude at rest after the decision
        cost = np.where(spared, np.abs(choices - wanted[:, None]), _LARGE + left)
        best = np.argmin(cost, axis=1)
        return choices[np.arange(len(best)), best], most


def _turned_to(
    given: np.ndarray, direction: np.ndarray, change: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Nearest to a change (N, 3) of those within bounds that are `given` (N,) along a direction, or come nearest to it:
    the change plus a multiple of the direction, cut to the bounds, which grows along the direction with the multiple.
    """
    least = np.full((len(change), 1), -_FARTHEST)
    most = -least
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + most)
        found = (direction * np.clip(change + middle * direction, low, high)).sum(axis=1, keepdims=True)
        least, most = np.where(found < given[:, None], middle, least), np.where(found < given[:, None], most, middle)
    return np.clip(change + most * direction, low, high)
