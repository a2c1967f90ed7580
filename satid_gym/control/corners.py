"""Excitation from corner to corner of the rate envelope, by reversals that panels and tanks allow.

At a corner all three body rates are at their limit, where they tell most of the inertia. Which axes reverse together
decides how far a mode bends: the parts of their changes along its d add up or cancel. And a tank moves so slowly that
it does not follow a rate which soon turns back. So those corners are open from which, a decision later, some corner
can be kept for good with every mode inside its limit (`satid_gym.control.observed_modes`): there is then a way to go
on. Of these the one with the highest score is taken; where none is open, the one that bends the modes least.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.observed_modes import Modes, ObservedModes
from satid_gym.control.rate_loop import RateMargin
from satid_gym.policy import Mission

FEATURES = (
    "waited",  # of the axes that reverse: their waits over the hold, -1 each that has not waited so long
    "reversals",  # their number
    "reversals_4s",  # sum of tanh(wait / 4 s)
    "reversals_12s",  # sum of tanh(wait / 12 s)
    "reversals_2s",  # sum of exp(-wait / 2 s)
    "unknown",  # sum of their moments' observed uncertainties, less the mean of the three
    "unknown_12s",  # the same times tanh(wait / 12 s)
    "coupled",  # sum of the sizes of d along them
    "coupled_12s",  # the same times tanh(wait / 12 s)
    "reversals_squared",  # their number squared, over 3
    "reversals_uncertainty",  # their number times the mean observed uncertainty
    "reversals_elapsed",  # times the share of the flight that is over
    "reversals_frequency",  # times ln(w T)
    "reversals_speed",  # times the size of deta/dt
    "any",  # whether any axis reverses
    "any_uncertainty",
    "any_elapsed",
    "any_frequency",
    "any_deflection",  # times the size of eta
    "peak",  # after one decision at the corner and then the best, at most 1.2
    "peak_3",  # after three, at most 2
    "peak_kept",  # if the corner is kept, at most 3
    "peak_kept_frequency",
    "drive",  # size of the rate along d
    "drive_frequency",
    "drive_deflection",  # rate along d times eta
    "drive_speed",  # times deta/dt
)
"""Features that score a corner, in order. w, d, eta and deta/dt are those of the mode nearest to its limit, eta and
deta/dt over that limit."""
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
HOLD = 7.0  # s
_FIRST_WAITS = np.array([1.0, 2.0 / 3.0, 1.0 / 3.0])  # of the hold, so that the axes do not begin together
_CLOSED = 1e6  # what a closed corner loses by its peak
_SLOWEST = 1e-3  # w T
Score = Callable[[np.ndarray], np.ndarray]
"""Scores (N, 8) of corners by their features (N, 8, features)."""


class CornerTour:
    """Chooses corners and turns them into actions that spare the modes; for environments whose rate loop is their own.

    Args:
        missions: the satellites that are flown; all with the same layout and decision period.
        margin: see `RateMargin`.
        hold: time after which an axis may well reverse again, s.
        share, caution: see `ObservedModes`.

    Raises:
        ValueError: a number is out of range, the environment takes torques, or modes are not observed.
    """

    def __init__(
        self, missions: Sequence[Mission], margin: float, hold: float = HOLD, share: float = 0.9, caution: float = 1.0
    ) -> None:
        self._hold = check_number("hold", hold, strict=True)
        self._modes, self._allowed = ObservedModes(missions, share, caution), RateMargin(missions, margin)
        self._layout, self._duration = missions[0].layout, missions[0].scenario.decision_period
        self.begin(0)

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._allowed.assign(rows)
        self._modes.assign(rows)

    def begin(self, episodes: int) -> None:
        """Begin that many episodes."""
        self._side = np.ones((episodes, 3))
        self._waited = np.tile(self._hold * _FIRST_WAITS, (episodes, 1))

    def __call__(self, observation: np.ndarray, score: Score | None = None) -> np.ndarray:
        """Action (N, 3) for observations (N, size); without a score, by how long the axes that reverse have waited."""
        corners = _CORNERS * self._allowed(observation, np.ones(3))[:, None]
        corners = np.broadcast_to(corners, (len(observation), *_CORNERS.shape))
        modes = self._modes.read(observation)
        peak = self._modes.peaks_of_turns(modes, corners)
        reverses = self._side[:, None] != _CORNERS
        if score is None:
            scores = self._waits(reverses)
        else:
            scores = score(self._features(observation, modes, corners, peak, reverses))
        episodes, best = np.arange(len(corners)), np.argmax(np.where(peak <= 1.0, scores, -_CLOSED * peak), axis=1)
        self._side = _CORNERS[best]
        self._waited = np.where(reverses[episodes, best], 0.0, self._waited) + self._duration
        return corners[episodes, best]

    def _waits(self, reverses: np.ndarray) -> np.ndarray:
        """Waits (N, 8) over the hold of the axes (N, 8, 3) that reverse, -1 each that has not waited so long."""
        own = np.where(self._waited >= self._hold, self._waited / self._hold, -1.0)
        return (reverses * own[:, None]).sum(axis=2)

    def _features(
        self, observation: np.ndarray, modes: Modes, corners: np.ndarray, peak: np.ndarray, reverses: np.ndarray
    ) -> np.ndarray:
        """(N, 8, features), see `FEATURES`."""
        seen = {name: observation[:, self._layout[name]].astype(float) for name in ("uncertainty", "time_left")}
        unknown, waited = seen["uncertainty"][:, :3], self._waited
        mean, gone = unknown.mean(axis=1)[:, None], 1.0 - seen["time_left"]
        direction, deflection, speed, frequency = _nearest(modes)
        kept, later = self._modes.peaks(modes, corners), self._modes.peaks_of_turns(modes, corners, 3)
        count = reverses.sum(axis=2).astype(float)
        some, kept = (count > 0.0).astype(float), np.minimum(kept, 3.0)
        drive = (corners @ direction[:, :, None])[:, :, 0]

        def sum_of(each: np.ndarray) -> np.ndarray:
            return (reverses * each[:, None]).sum(axis=2)

        slow = np.tanh(waited / 12.0)
        parts = {
            "waited": self._waits(reverses),
            "reversals": count,
            "reversals_4s": sum_of(np.tanh(waited / 4.0)),
            "reversals_12s": sum_of(slow),
            "reversals_2s": sum_of(np.exp(-waited / 2.0)),
            "unknown": sum_of(unknown - mean),
            "unknown_12s": sum_of((unknown - mean) * slow),
            "coupled": sum_of(np.abs(direction)),
            "coupled_12s": sum_of(np.abs(direction) * slow),
            "reversals_squared": count**2 / 3.0,
            "reversals_uncertainty": count * mean,
            "reversals_elapsed": count * gone,
            "reversals_frequency": count * frequency,
            "reversals_speed": count * np.abs(speed),
            "any": some,
            "any_uncertainty": some * mean,
            "any_elapsed": some * gone,
            "any_frequency": some * frequency,
            "any_deflection": some * np.abs(deflection),
            "peak": np.minimum(peak, 1.2),
            "peak_3": np.minimum(later, 2.0),
            "peak_kept": kept,
            "peak_kept_frequency": kept * frequency,
            "drive": np.abs(drive),
            "drive_frequency": np.abs(drive) * frequency,
            "drive_deflection": drive * deflection,
            "drive_speed": drive * speed,
        }
        return np.stack([parts[name] for name in FEATURES], axis=2)


def _nearest(modes: Modes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of the mode nearest to its limit: unit vector of d (N, 3), eta and deta/dt / w over the limit, ln(w T), each
    (N, 1); zeros where there is none."""
    if modes.limit.shape[1] == 0:
        none = np.zeros((len(modes.limit), 1))
        return np.zeros((len(none), 3)), none, none, none
    over = modes.swing / modes.limit[:, :, None]
    row, nearest = np.arange(len(over)), np.argmax(np.hypot(over[:, :, 0], over[:, :, 1]), axis=1)
    deflection, speed = over[row, nearest].T[:, :, None]
    frequency = np.log(np.maximum(modes.turned[row, nearest], _SLOWEST))[:, None]
    return modes.direction[row, nearest], deflection, speed, frequency
