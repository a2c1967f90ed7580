"""Features of the corners of the rate envelope, by which a score chooses among them; see `satid_gym.control.corners`.

What a turn to a corner tells of the inertia is weighed by the uncertainties that are observed, as if they were not
correlated. The change v of the rate is measured about each axis i, in units of the rate limit, with variance R, and
depends on the parameter theta_ij by v_j sqrt(J_jj / J_ii), in units of its scale:

    gain = 1/6 sum_i ln(1 + s_i / R)
    s_i = sum_j v_j^2 (J_jj / J_ii) std(theta_ij)^2
    R = T_s sigma^2 (1 / t + 1 / 7 s)

in nats an axis, with sigma the noise of the gyro's samples, T_s apart, averaged over the t seconds since the last
reversal and some seconds after this one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from satid_gym.control.observed_modes import Modes, ObservedModes
from satid_gym.core.observation import observed_std
from satid_gym.estimators.inertia import PRODUCTS, inertia_parameters
from satid_gym.policy import Mission

HOLD = 7.0  # s
_SLOWEST = 1e-3  # w T
_EARLY = 10.0  # s
_LATE = 30.0  # s


class Craft(NamedTuple):
    """What the data sheets of N satellites say that observations leave out.

    Attributes:
        inertia: (N, 3, 3) of the prior, kg m^2.
        momentum: (N, 3) that all wheels together have along each body axis, N m s.
        rate_limit: (N,) rad/s.
        noise: (N,) variance of the mean of a second of gyro samples, over the rate limit squared.
    """

    inertia: np.ndarray
    momentum: np.ndarray
    rate_limit: np.ndarray
    noise: np.ndarray

    @classmethod
    def of(cls, missions: Sequence[Mission]) -> Craft:
        """Those of missions."""
        rows = []
        for mission in missions:
            satellite, wheels = mission.satellite, mission.satellite.wheels
            noise = mission.scenario.sample_period * (satellite.gyro_noise_std / satellite.rate_limit) ** 2
            stored = np.abs(wheels.axes) @ (wheels.inertia * wheels.max_speed)
            rows.append((mission.prior.inertia, stored, satellite.rate_limit, noise))
        return cls(*(np.array(part) for part in zip(*rows, strict=True)))

    def take(self, rows: np.ndarray) -> Craft:
        """Those of some rows."""
        return Craft(*(part[rows] for part in self))


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
    def gone(self) -> np.ndarray:
        """(N, 1) share of the flight that is over."""
        return 1.0 - self.seen["time_left"]

    @cached_property
    def early(self) -> np.ndarray:
        """(N, 1) from 1, where the episode begins, to 0."""
        return np.exp(-self.gone * self.decisions * self.period / _EARLY)

    @cached_property
    def late(self) -> np.ndarray:
        """(N, 1) 1, and in the last half minute to 0."""
        return np.minimum(self.seen["time_left"] * self.decisions * self.period / _LATE, 1.0)

    @cached_property
    def slew(self) -> np.ndarray:
        """(N, 1) log of the time, s, that it takes to reverse an axis, mean of the three."""
        return np.log(2.0 * self.period / self.seen["control_authority"]).mean(axis=1)[:, None]

    @cached_property
    def turn(self) -> np.ndarray:
        """(N, 8, 3) change of the rate to a corner, over the limit."""
        return self.corners - self.seen["rate"][:, None]

    @cached_property
    def _nearest(self) -> tuple[np.ndarray, ...]:
        """Of the mode nearest to its limit: unit vector of d (N, 3), eta and deta/dt / w over the limit, ln(w T), each
        (N, 1); zeros where there is none."""
        modes = self.modes
        if modes.limit.shape[1] == 0:
            none = np.zeros((len(modes.limit), 1))
            return np.zeros((len(none), 3)), none, none, none
        over = modes.swing / modes.limit[:, :, None]
        row, nearest = np.arange(len(over)), np.argmax(np.hypot(over[:, :, 0], over[:, :, 1]), axis=1)
        deflection, speed = over[row, nearest].T[:, :, None]
        frequency = np.log(np.maximum(modes.turned[row, nearest], _SLOWEST))[:, None]
        return modes.direction[row, nearest], deflection, speed, frequency

    @property
    def direction(self) -> np.ndarray:
        """(N, 3) of d of that mode."""
        return self._nearest[0]

    @property
    def deflection(self) -> np.ndarray:
        """(N, 1) its eta, over the limit."""
        return self._nearest[1]

    @property
    def speed(self) -> np.ndarray:
        """(N, 1) its deta/dt / w, over the limit."""
        return self._nearest[2]

    @property
    def frequency(self) -> np.ndarray:
        """(N, 1) its ln(w T)."""
        return self._nearest[3]

    @cached_property
    def drive(self) -> np.ndarray:
        """(N, 8) rate along its d."""
        return (self.corners @ self.direction[:, :, None])[:, :, 0]

    @cached_property
    def kept(self) -> np.ndarray:
        """(N, 8) peak if the corner is kept, at most 3."""
        return np.minimum(self.foreseen.peaks(self.modes, self.corners), 3.0)

    @cached_property
    def later(self) -> np.ndarray:
        """(N, 8) peak after three decisions at the corner and then the best, at most 2."""
        return np.minimum(self.foreseen.peaks_of_turns(self.modes, self.corners, 3), 2.0)

    @cached_property
    def _variance(self) -> np.ndarray:
        """(N, 3, 3) [j, i]: (J_jj / J_ii) std(theta_ij)^2 / R."""
        variance = observed_std(self.seen["uncertainty"]) ** 2
        moments = np.diagonal(self.craft.inertia, axis1=1, axis2=2)
        spread = np.zeros((len(variance), 3, 3))
        for i in range(3):
            spread[:, i, i] = variance[:, i]
        for k, (i, j) in enumerate(PRODUCTS[: variance.shape[1] - 3]):
            spread[:, i, j] = spread[:, j, i] = variance[:, 3 + k]
        noise = self.craft.noise * (1.0 / self.waited.min(axis=1) + 1.0 / HOLD)
        return spread * (moments[:, :, None] / moments[:, None]) / noise[:, None, None]

    def gain(self, decisions: float = np.inf) -> np.ndarray:
        """(N, 8) nats an axis that a turn to a corner tells in some decisions, or when it is complete."""
        turn = self.turn
        if np.isfinite(decisions):
            most = decisions * self.seen["control_authority"][:, None]
            turn = np.clip(turn, -most, most)
        return np.log1p(turn**2 @ self._variance).sum(axis=2) / 6.0

    @cached_property
    def complete_gain(self) -> np.ndarray:
        """(N, 8) `gain` of a complete turn."""
        return self.gain()

    @cached_property
    def _tensor(self) -> np.ndarray:
        """(N, 3, 3) estimated inertia, kg m^2."""
        craft, tensor = self.craft, self.craft.inertia.copy()
        off = self.seen["inertia"]
        scale = inertia_parameters(tensor, "full")
        for i in range(3):
            tensor[:, i, i] *= np.maximum(1.0 + off[:, i], 0.1)
        for k, (i, j) in enumerate(PRODUCTS[: off.shape[1] - 3]):
            tensor[:, i, j] = tensor[:, j, i] = craft.inertia[:, i, j] + off[:, 3 + k] * np.sqrt(
                scale[:, i] * scale[:, j]
            )
        return tensor

    @cached_property
    def _stored(self) -> np.ndarray:
        """(N, 3) total momentum, body frame, N m s."""
        craft = self.craft
        body = (self._tensor @ self.seen["rate"][:, :, None])[:, :, 0] * craft.rate_limit[:, None]
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


FEATURES: dict[str, Callable[[Choice], np.ndarray]] = {
    "waited": lambda c: c.own,  # the law by waits: of axes that reverse, waits over the hold, -1 each that is too early
    "reversals": lambda c: c.count,
    "reversals_2s": lambda c: c.sum_of(np.exp(-c.waited / 2.0)),
    "reversals_4s": lambda c: c.sum_of(np.tanh(c.waited / 4.0)),
    "reversals_12s": lambda c: c.sum_of(c.slow),
    "reversals_squared": lambda c: c.count**2 / 3.0,
    "reversals_uncertainty": lambda c: c.count * c.uncertainty,
    "reversals_elapsed": lambda c: c.count * c.gone,
    "reversals_early": lambda c: c.count * c.early,
    "reversals_late": lambda c: c.count * c.late,
    "reversals_slew": lambda c: c.count * c.slew,
    "reversals_slewed": lambda c: c.sum_of(np.tanh(c.waited * c.seen["control_authority"] / (2.0 * c.period))),
    "reversals_frequency": lambda c: c.count * c.frequency,
    "reversals_speed": lambda c: c.count * np.abs(c.speed),
    "unknown": lambda c: c.sum_of(c.unknown),
    "unknown_12s": lambda c: c.sum_of(c.unknown * c.slow),
    "coupled": lambda c: c.sum_of(np.abs(c.direction)),
    "coupled_12s": lambda c: c.sum_of(np.abs(c.direction) * c.slow),
    "any": lambda c: c.some,
    "any_uncertainty": lambda c: c.some * c.uncertainty,
    "any_elapsed": lambda c: c.some * c.gone,
    "any_early": lambda c: c.some * c.early,
    "any_late": lambda c: c.some * c.late,
    "any_slew": lambda c: c.some * c.slew,
    "any_nis": lambda c: c.some * c.seen["nis"],
    "any_frequency": lambda c: c.some * c.frequency,
    "any_deflection": lambda c: c.some * np.abs(c.deflection),
    "gain": lambda c: c.complete_gain,  # of a complete turn, see above
    "gain_1": lambda c: c.gain(1.0),  # of what is turned in one decision
    "gain_3": lambda c: c.gain(3.0),
    "gain_10": lambda c: c.gain(10.0),
    "gain_uncertainty": lambda c: c.complete_gain * c.uncertainty,
    "gain_early": lambda c: c.complete_gain * c.early,
    "underway": lambda c: np.tanh((np.abs(c.turn) / c.seen["control_authority"][:, None]).max(axis=2) / 4.0),
    "fullness": lambda c: c.fullness,
    "fullness_beyond": lambda c: 3.0 * np.maximum(c.fullness - 0.7, 0.0),
    "load": lambda c: c.load,
    "load_beyond": lambda c: 3.0 * np.maximum(c.load - 0.5, 0.0),
    "peak": lambda c: np.minimum(c.peak, 1.2),  # of modes, over their limit
    "peak_3": lambda c: c.later,
    "peak_kept": lambda c: c.kept,
    "peak_kept_frequency": lambda c: c.kept * c.frequency,
    "drive": lambda c: np.abs(c.drive),
    "drive_frequency": lambda c: np.abs(c.drive) * c.frequency,
    "drive_deflection": lambda c: c.drive * c.deflection,
    "drive_speed": lambda c: c.drive * c.speed,
}
"""Features (N, 8) of corners by name: products of the properties of a `Choice`."""
_OF_MODES = ("frequency", "speed", "coupled", "deflection", "peak", "drive")
RIGID = tuple(name for name in FEATURES if not any(part in name for part in _OF_MODES))
"""Those that a satellite without panels and tanks has."""


def check_features(names: Sequence[str]) -> tuple[str, ...]:
    """The names, checked.

    Raises:
        ValueError: one is unknown or twice there.
    """
    unknown = [name for name in names if name not in FEATURES]
    if unknown or len(set(names)) < len(names):
        raise ValueError(f"features of corners are each of {', '.join(FEATURES)}, at most once; got {list(names)}")
    return tuple(names)
