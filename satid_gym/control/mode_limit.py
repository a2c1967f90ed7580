"""Rate commands that keep panels and tanks inside their limit of deflection.

The command in force goes towards the wanted one as far as that leaves each mode inside a share of its limit if the
rates then stay (`satid_gym.control.observed_modes`). So what was found to be inside stays possible at the next
decision. Where nothing on the way is inside, because the filter knows better now, the change along d that rings least
is taken.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.control.observed_modes import ObservedModes
from satid_gym.control.rate_loop import RateMargin
from satid_gym.policy import Mission

_WAYS = np.array([0.0, 0.02, 0.04, 0.08, 0.15, 0.25, 0.4, 0.6, 0.8, 1.0])  # shares of the way that are tried
_DAMPING = np.linspace(-2.0, 2.0, 17)  # changes along d, rate limits


class ModeLimit:
    """Turns rate commands into actions that spare the modes; for environments whose rate loop is their own.

    Args:
        missions: the satellites that are flown; all with the same layout and decision period.
        margin: see `RateMargin`.
        share, caution: see `ObservedModes`.

    Raises:
        ValueError: a number is out of range, the environment takes torques, or modes are not observed.
    """

    def __init__(self, missions: Sequence[Mission], margin: float, share: float = 0.9, caution: float = 1.0) -> None:
        self._modes = ObservedModes(missions, share, caution)
        self._margin, self._place = RateMargin(missions, margin), missions[0].layout["command"]

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._margin.assign(rows)
        self._modes.assign(rows)

    def state(self) -> np.ndarray:
        """Data sheets (N, modes, 2) that were noted, for `restore`."""
        return self._modes.state()

    def restore(self, state: np.ndarray) -> None:
        """Return to a `state`."""
        self._modes.restore(state)

    def __call__(self, observation: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Action (N, 3) for observations (N, size) and rate commands (N, 3) in [-1, 1]."""
        wanted, held = self._margin(observation, command), observation[:, self._place].astype(float)
        modes = self._modes.read(observation)
        if modes.limit.shape[1] == 0:
            return wanted
        choices = held[:, None] + _WAYS[:, None] * (wanted - held)[:, None]
        spared = self._modes.peaks(modes, choices) <= 1.0
        last = len(_WAYS) - 1 - np.argmax(spared[:, ::-1], axis=1)
        action = choices[np.arange(len(held)), last]
        rings = np.flatnonzero(~spared.any(axis=1))
        if len(rings):
            ringing = modes.of(rings)
            most = np.argmax(np.hypot(ringing.swing[:, :, 0], ringing.swing[:, :, 1]) / ringing.limit, axis=1)
            along = ringing.direction[np.arange(len(rings)), most]
            edge = self._margin(observation, np.ones(3))[rings, None]
            choices = np.clip(held[rings, None] + _DAMPING[:, None] * along[:, None], -edge, edge)
            best = np.argmin(self._modes.peaks(ringing, choices), axis=1)
            action[rings] = choices[np.arange(len(rings)), best]
        return action
