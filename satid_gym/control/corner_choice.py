"""Situation in which a corner of the rate envelope is chosen: what turns there tell, the modes and the wheels.

What a turn to a corner tells of the inertia is weighed by the covariance of its parameters as observed. The change v of
the rate is measured about each axis with variance R, in units of the rate limit squared, and depends on theta by H:

    gain = 1/6 ln det(1 + H P H^T / R),  H[i, ij] = v_j sqrt(J_jj / J_ii),  R = T_s sigma^2 (1 / t + 1 / 7 s)

in nats an axis, with P in units of theta's scale and sigma the noise of the gyro's samples, T_s apart, averaged over
the t seconds since the last reversal and some seconds after this one. Source: Chaloner and Verdinelli 1995, Bayesian
experimental design: a review, Statistical Science 10, for the expected gain of a linear measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from satid_gym.control.craft import Craft
from satid_gym.control.decoded_observation import observed_inertia, times
from satid_gym.control.observed_modes import Modes, ObservedModes
from satid_gym.control.stars_seen import StarsSeen
from satid_gym.core.observation import observed_std, state_pairs
from satid_gym.core.observed_sky import WINDOW_UNIT
from satid_gym.estimators.inertia import PRODUCTS, inertia_parameters

HOLD = 7.0  # s
_SLOWEST = 1e-3  # w T
EARLY, LATE = 10.0, 30.0  # s
SHORT = 3.0  # s at the rate limit, a turn that stars tell little of


@cache
def _correlations_of_theta(p: int, others: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where `state_correlation` has those of the inertia parameters, and which two parameters each is of."""
    found = [(i, r - 3, c - 3) for i, (r, c) in enumerate(state_pairs(p, others)) if r >= 3 and c < 3 + p]
    places, rows, columns = np.array(found).T
    return places, rows, columns


class NearestMode(NamedTuple):
    """Mode nearest to its limit, of N episodes; zeros where there is none.

    Attributes:
        direction: (N, 3) unit vector of d.
        deflection, speed: (N, 1) eta and deta/dt / w, over the limit.
        frequency: (N, 1) ln(w T).
    """

    direction: np.ndarray
    deflection: np.ndarray
    speed: np.ndarray
    frequency: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Choice:
    """What is known of N episodes when a corner is chosen.

    Attributes:
        seen: parts of the observation by name, (N, size).
        craft: the satellites.
        corners: (N, 8, 3) rates over the limit.
        reverses: (N, 8, 3) whether a corner reverses an axis.
        waited: (N, 3) time since each axis reversed, s.
        own: (N, 8) score of the law by waits.
        stars: what the star trackers have seen, where there are any.
        modes: of panels and tanks.
        foreseen: forecasts these.
        peak: (N, 8) of them after one decision at a corner and then the best.
        period: of decisions, s.
        decisions: of the episode.
    """

    seen: dict[str, np.ndarray]
    craft: Craft
    corners: np.ndarray
    reverses: np.ndarray
    waited: np.ndarray
    own: np.ndarray
    stars: StarsSeen | None
    modes: Modes
    foreseen: ObservedModes
    peak: np.ndarray
    period: float
    decisions: int

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
        """(N, 1) to 1, as the time that a gap between imaging windows leaves beside the way to the target runs out."""
        way = np.abs(self.seen["target"]).max(axis=1) / self.craft.rate_limit
        left = WINDOW_UNIT * self.seen["window"][:, 0] - way
        return np.exp(-np.maximum(left, 0.0) / EARLY)[:, None]

    @cached_property
    def rest(self) -> np.ndarray:
        """(N, 9) 1 of the rest, 0 of corners."""
        return (~self.corners.any(axis=2)).astype(float)

    @property
    def seen_stars(self) -> StarsSeen:
        """What the star trackers have seen."""
        assert self.stars is not None
        return self.stars

    @cached_property
    def onward(self) -> np.ndarray:
        """(N, 8) of a corner along what was turned since the stars were read, which is longer by that."""
        return (self.corners @ self.seen_stars.turned[:, :, None])[:, :, 0] / LATE

    @cached_property
    def told(self) -> np.ndarray:
        """(N, 1) log of how much what stars tell of the scale would grow by a reading now, mean of the axes."""
        stars = self.seen_stars
        return np.log1p(stars.turned**2 / (SHORT**2 + stars.squares)).mean(axis=1)[:, None]

    @cached_property
    def later_told(self) -> np.ndarray:
        """(N, 8) by how much that is more after some seconds at a corner."""
        stars = self.seen_stars
        turned = stars.turned[:, None] + HOLD * self.corners
        return np.log1p(turned**2 / (SHORT**2 + stars.squares)[:, None]).mean(axis=2) - self.told

    @cached_property
    def towards(self) -> np.ndarray:
        """(N, 8) of a corner along the way to the target, in radians."""
        return (self.corners @ self.seen["target"][:, :, None])[:, :, 0]

    @cached_property
    def turn(self) -> np.ndarray:
        """(N, 8, 3) change of the rate to a corner, over the limit."""
        return self.corners - self.seen["rate"][:, None]

    @cached_property
    def mode(self) -> NearestMode:
        """The mode that is nearest to its limit."""
        modes = self.modes
        if modes.limit.shape[1] == 0:
            none = np.zeros((len(modes.limit), 1))
            return NearestMode(np.zeros((len(none), 3)), none, none, none)
        over = modes.swing / modes.limit[:, :, None]
        row, nearest = np.arange(len(over)), np.argmax(np.hypot(over[:, :, 0], over[:, :, 1]), axis=1)
        deflection, speed = over[row, nearest].T[:, :, None]
        frequency = np.log(np.maximum(modes.turned[row, nearest], _SLOWEST))[:, None]
        return NearestMode(modes.direction[row, nearest], deflection, speed, frequency)

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

    @cached_property
    def _sensitivity(self) -> np.ndarray:
        """(N, 3, 3 p) [j, (i, k)]: of the rate's change about axis i by that about j times theta_k, over sqrt(R)."""
        moments = inertia_parameters(self.craft.inertia, "principal")
        noise = self.craft.noise * (1.0 / self.waited.min(axis=1) + 1.0 / HOLD)
        size = np.sqrt(moments[:, None] / moments[:, :, None] / noise[:, None, None])
        p = self.seen["uncertainty"].shape[1]
        by = np.zeros((len(size), 3, 3, p))
        for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), *PRODUCTS][:p]):
            by[:, j, i, k], by[:, i, j, k] = size[:, i, j], size[:, j, i]
        return by.reshape(len(size), 3, 3 * p)

    @cached_property
    def _covariance(self) -> np.ndarray:
        """(N, p, p) of theta over its scale; without the whole covariance among what is seen, as if not correlated."""
        std = observed_std(self.seen["uncertainty"])
        count, p = std.shape
        correlation = np.tile(np.eye(p), (count, 1, 1))
        if "state_correlation" in self.seen:
            others = self.seen["state_uncertainty"].shape[1]
            places, rows, columns = _correlations_of_theta(p, others)
            value = self.seen["state_correlation"][:, places]
            correlation[:, rows, columns] = correlation[:, columns, rows] = value
        return correlation * std[:, :, None] * std[:, None]

    def gain(self, decisions: float = np.inf) -> np.ndarray:
        """(N, 8) nats an axis that a turn to a corner tells in some decisions, or when it is complete."""
        turn = self.turn
        if np.isfinite(decisions):
            most = decisions * self.seen["control_authority"][:, None]
            turn = np.clip(turn, -most, most)
        count, p = self.seen["uncertainty"].shape
        told = (turn @ self._sensitivity).reshape(count, -1, 3, p)
        spread = told @ self._covariance[:, None] @ told.swapaxes(2, 3)
        a, b, c, d, e, f = (spread[:, :, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        a, b, c = 1.0 + a, 1.0 + b, 1.0 + c
        det = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
        return np.log(np.maximum(det, 1.0)) / 6.0  # rounding of what is observed may make it less than 1

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
        craft = self.craft
        body = times(self._tensor, self.seen["rate"]) * craft.rate_limit[:, None]
        return body + craft.momentum * self.seen["wheel_momentum"]

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
