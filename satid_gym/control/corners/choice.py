"""Situation in which a corner of the rate envelope is chosen: the inertia, the modes, the wheels, stars and windows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from satid_gym.control.corners.nearest_mode import NearestMode
from satid_gym.control.corners.star_fixes import StarFixes
from satid_gym.control.corners.turn_gain import HOLD, TurnGain
from satid_gym.control.corners.wheel_band import BandWays
from satid_gym.control.craft import Craft
from satid_gym.control.decoded_observation import observed_inertia
from satid_gym.control.observed_modes import Modes, ObservedModes
from satid_gym.core.observed_sky import WINDOW_UNIT

EARLY, LATE = 10.0, 30.0  # s
CLOSING = 10.0  # s, the time constant of `closing`
SHORT = 3.0  # s at the rate limit, a rotation of which star fixes tell little


@dataclass(frozen=True, eq=False, kw_only=True)
class Choice:
    """What is known of N episodes when a corner is chosen: of 8 ways, or of 16 where wheels avoid a band of speed.

    Attributes:
        seen: parts of the observation by name, (N, size); `control_authority` is at most what modes allow where ways
            are shaped.
        craft: the satellites.
        corners: (N, 8, 3) rates over the limit.
        reverses: (N, 8, 3) whether a corner reverses an axis.
        waited: (N, 3) time since each axis reversed, s.
        wait_score: (N, 8) score of the law by waits.
        fixes: of star trackers, where a feature needs them.
        modes: of panels and tanks.
        foreseen: forecasts these.
        peak: (N, 8) of them after one decision at a corner and then the best.
        period: of decisions, s.
        decisions: of the episode.
        band: what the ways do to wheels that avoid a band of speed, where a feature needs it.
    """

    seen: dict[str, np.ndarray]
    craft: Craft
    corners: np.ndarray
    reverses: np.ndarray
    waited: np.ndarray
    wait_score: np.ndarray
    fixes: StarFixes | None
    modes: Modes
    foreseen: ObservedModes
    peak: np.ndarray
    period: float
    decisions: int
    band: BandWays | None

    def sum_of(self, each: np.ndarray) -> np.ndarray:
        """(N, 8) sum of a value (N, 3) of each axis over those that a corner reverses."""
        return (self.reverses * each[:, None]).sum(axis=2)

    @cached_property
    def count(self) -> np.ndarray:
        """(N, 8) axes that a corner reverses."""
        return self.reverses.sum(axis=2).astype(float)

    @cached_property
    def some(self) -> np.ndarray:
        """(N, 8) whether there are any."""
        return (self.count > 0.0).astype(float)

    @cached_property
    def slow(self) -> np.ndarray:
        """(N, 3) waits, flat beyond some 12 s."""
        return np.tanh(self.waited / 12.0)

    @cached_property
    def uncertainty(self) -> np.ndarray:
        """(N, 1) mean of the moments' observed uncertainties."""
        return self.seen["uncertainty"][:, :3].mean(axis=1)[:, None]

    @cached_property
    def unknown(self) -> np.ndarray:
        """(N, 3) each moment's, less that mean."""
        return self.seen["uncertainty"][:, :3] - self.uncertainty

    @cached_property
    def walk(self) -> np.ndarray:
        """(N, 1) observed random walk of the inertia."""
        return self.seen["inertia_walk"]

    @cached_property
    def gone(self) -> np.ndarray:
        """(N, 1) share of the flight that is over."""
        return 1.0 - self.seen["time_left"]

    @cached_property
    def early(self) -> np.ndarray:
        """(N, 1) from 1, where the episode begins, to 0."""
        return np.exp(-self.gone * self.decisions * self.period / EARLY)

    @cached_property
    def late(self) -> np.ndarray:
        """(N, 1) 1, and in the last half minute to 0."""
        return np.minimum(self.seen["time_left"] * self.decisions * self.period / LATE, 1.0)

    @cached_property
    def slew(self) -> np.ndarray:
        """(N, 1) log of the time, s, that it takes to reverse an axis, mean of the three."""
        return np.log(2.0 * self.period / self.seen["control_authority"]).mean(axis=1)[:, None]

    @cached_property
    def slewed(self) -> np.ndarray:
        """(N, 3) waits over the time that it takes to reverse an axis."""
        return self.waited * self.seen["control_authority"] / (2.0 * self.period)

    @cached_property
    def closing(self) -> np.ndarray:
        """(N, 1) 0 early in a gap between imaging windows, 1 where it leaves no more time than the slew takes."""
        slew = np.abs(self.seen["target"]).max(axis=1) / self.craft.rate_limit
        left = WINDOW_UNIT * self.seen["window"][:, 0] - slew
        return np.exp(-np.maximum(left, 0.0) / CLOSING)[:, None]

    @cached_property
    def onward(self) -> np.ndarray:
        """(N, 8) how far a corner goes on with the rotation since the last star fix."""
        assert self.fixes is not None
        return (self.corners @ self.fixes.turn[:, :, None])[:, :, 0] / LATE

    @cached_property
    def star_gain(self) -> np.ndarray:
        """(N, 8) how much more the next star fix tells of the scale after some seconds at a corner, mean of the axes.

        In logarithms: each axis is known by the squares of its rotations between fixes.
        """
        assert self.fixes is not None
        known = SHORT**2 + self.fixes.squares
        now = np.log1p(self.fixes.turn**2 / known).mean(axis=1)[:, None]
        turn = self.fixes.turn[:, None] + HOLD * self.corners
        return np.log1p(turn**2 / known[:, None]).mean(axis=2) - now

    @cached_property
    def towards(self) -> np.ndarray:
        """(N, 8) how far a corner leads towards the target, rad."""
        return (self.corners @ self.seen["target"][:, :, None])[:, :, 0]

    @property
    def crossing(self) -> np.ndarray:
        """(N, 16) tenths of a second that a wheel is in the band on the way to a corner."""
        assert self.band is not None
        return 10.0 * self.band.crossing

    @property
    def stay(self) -> np.ndarray:
        """(N, 16) tenths of the next seconds at a corner that a wheel is in the band, or almost."""
        assert self.band is not None
        return 10.0 * self.band.stay

    @cached_property
    def turn(self) -> np.ndarray:
        """(N, 8, 3) change of the rate to a corner, over the limit."""
        return self.corners - self.seen["rate"][:, None]

    @cached_property
    def mode(self) -> NearestMode:
        """The mode that is nearest to its limit."""
        return NearestMode.of(self.modes)

    @cached_property
    def pull(self) -> np.ndarray:
        """(N, 8) deflection to which a corner's rotation pulls the mode nearest to its limit, over that; 0 without."""
        if self.modes.limit.shape[1] == 0:
            return np.zeros(self.corners.shape[:2])
        row, nearest = np.arange(len(self.corners)), self.mode.number
        return self.modes.pulled(self.corners)[row, :, nearest] / self.modes.limit[row, nearest][:, None]

    @cached_property
    def drive(self) -> np.ndarray:
        """(N, 8) rate along its d."""
        return (self.corners @ self.mode.direction[:, :, None])[:, :, 0]

    @cached_property
    def kept(self) -> np.ndarray:
        """(N, 8) peak if the corner is kept, at most 3."""
        return np.minimum(self.foreseen.peaks(self.modes, self.corners), 3.0)

    @cached_property
    def later(self) -> np.ndarray:
        """(N, 8) peak after three decisions at the corner and then the best, at most 2."""
        return np.minimum(self.foreseen.peaks_of_turns(self.modes, self.corners, 3), 2.0)

    def gain(self, decisions: float = np.inf) -> np.ndarray:
        """(N, 8) nats an axis that a turn to a corner tells in some decisions, or when it is complete."""
        turn = self.turn
        if np.isfinite(decisions):
            most = decisions * self.seen["control_authority"][:, None]
            turn = np.clip(turn, -most, most)
        return self._gain(turn)

    @cached_property
    def _gain(self) -> TurnGain:
        return TurnGain(self.seen, self.craft, self.waited.min(axis=1))

    @cached_property
    def complete_gain(self) -> np.ndarray:
        """(N, 8) `gain` of a complete turn."""
        return self.gain()

    @cached_property
    def next_gain(self) -> np.ndarray:
        """(N, 8) `gain` of what is turned in one decision."""
        return self.gain(1.0)

    @cached_property
    def _tensor(self) -> np.ndarray:
        """(N, 3, 3) estimated inertia, kg m^2."""
        return observed_inertia(self.seen["inertia"], self.craft.inertia)

    @cached_property
    def _stored(self) -> np.ndarray:
        """(N, 3) total momentum, body frame, N m s."""
        return self.craft.stored(self._tensor, self.seen["rate"], self.seen["wheel_momentum"])

    @cached_property
    def fullness(self) -> np.ndarray:
        """(N, 8) largest share of the wheels' momentum along a body axis at a corner."""
        craft = self.craft
        body = (self.corners @ self._tensor) * craft.rate_limit[:, None, None]
        return np.abs((self._stored[:, None] - body) / craft.momentum[:, None]).max(axis=2)

    @cached_property
    def load(self) -> np.ndarray:
        """(N, 8) largest share of the torque about an axis that holding a corner takes, at most 2."""
        drift = np.linalg.solve(self._tensor, np.cross(self._stored[:, None], self.corners).transpose(0, 2, 1))
        share = np.abs(drift.transpose(0, 2, 1)) * self.period / self.seen["control_authority"][:, None]
        return np.minimum(share.max(axis=2), 2.0)
