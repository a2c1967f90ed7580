"""Pointing of a payload by rate commands: to the next target in time, and never too near the Sun.

The shortest way turns about the axis of the observed turn. Its rate falls with the square root of what is left, as a
constant deceleration has it, and in proportion at the end. A rate that would bring the boresight into the keep-out is
led along its edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.control.rate_loop import RateMargin
from satid_gym.core.observed_sky import WINDOW_UNIT
from satid_gym.policy import Mission, check_commands_rates

_BRAKING = 0.25  # of the acceleration that full torque gives by prior inertia
_GAIN = 0.45  # 1/s, of the rate at the end of a slew over what is left
_CLOSE = 0.7  # of what a window allows, at which a slew is over
_EDGE_GAIN = 0.25  # 1/s, of the fastest approach to the keep-out over the distance
_EDGE = np.radians(1.5)  # distance from the keep-out that is kept
_ACROSS = 1e-6  # cosine of the angle between the boresight and an axis across it, rounded
_UNROLL = 8.0  # s before the target is to be held, at which the turn about the boresight ends


@dataclass(frozen=True)
class View:
    """What a batch of N observations says of windows, targets and Sun.

    Attributes:
        opens: (N,) s to the opening; negative while the window is open.
        angle: (N,) rad, to the target.
        axis: (N, 3) unit vector of the shortest way there, body frame.
        sun: (N, 3) direction of the Sun, body frame.
        most: (N, 3) rates that the envelope allows, over their limit.
    """

    opens: np.ndarray
    angle: np.ndarray
    axis: np.ndarray
    sun: np.ndarray
    most: np.ndarray


class Pointing:
    """Guidance of a batch of episodes.

    Args:
        missions: of a scenario with operations; all with the same layout.
        margin: see `RateMargin`.
        name: of the policy, for messages.

    Attributes:
        limit: (N,) rate limits, or (1,), rad/s.

    Raises:
        ValueError: actions are torques, or no windows are observed.
    """

    def __init__(self, missions: Sequence[Mission], margin: float, name: str) -> None:
        mission = missions[0]
        check_commands_rates(mission, name)
        operations = mission.scenario.operations
        if operations is None:
            raise ValueError(
                f"there are no imaging windows: {name} flies scenarios with operations, such as "
                f'"operations", and this is {mission.scenario.name!r}'
            )
        self.boresight, self.period = operations.boresight, mission.scenario.decision_period
        self._layout, self._allowed = mission.layout, RateMargin(missions, margin)
        self._all_limits = np.array([m.satellite.rate_limit for m in missions])
        self._all_brakes = np.array([_brake(m) for m in missions])
        self.limit, self._brake = self._all_limits[:1], self._all_brakes[:1]
        self._close = _CLOSE * min(operations.pointing, operations.steadiness / _GAIN)  # rad
        self._keep = operations.keep_out + _EDGE if operations.keep_out > 0.0 else 0.0

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._allowed.assign(rows)
        self.limit, self._brake = self._all_limits[rows], self._all_brakes[rows]

    def view(self, observation: np.ndarray) -> View:
        """What the observations (N, size) say."""
        opens = WINDOW_UNIT * observation[:, self._layout["window"]][:, 0].astype(float)
        turn = observation[:, self._layout["target"]].astype(float)
        angle = np.linalg.norm(turn, axis=1)
        axis = turn / np.maximum(angle, np.finfo(float).tiny)[:, None]
        sun = observation[:, self._layout["sun"]].astype(float)
        return View(opens, angle, axis, sun, self._allowed(observation, np.ones(3)))

    def fastest(self, view: View) -> np.ndarray:
        """Rates (N,) about the axes of the shortest way that the envelope allows, rad/s."""
        return self.limit * (view.most / np.maximum(np.abs(view.axis), 1e-9)).min(axis=1)

    def slew(self, view: View, fastest: np.ndarray) -> np.ndarray:
        """Actions (N, 3) towards the target, at most so fast (N,), rad/s."""
        rate = np.minimum(np.sqrt(2.0 * self._brake * view.angle), _GAIN * view.angle)
        return (np.minimum(rate, fastest) / self.limit)[:, None] * view.axis

    def duration(self, view: View, rolls: bool = False) -> np.ndarray:
        """s (N,) until the target is held, at the fastest, round the Sun where it is in the way.

        A body that `rolls` about the boresight turns its axes to the way, so that it may be no faster than about one.
        """
        fastest, brake = self.fastest(view), self._brake
        if rolls:
            fastest = np.minimum(fastest, self.limit * view.most.min(axis=1))
        linear = np.minimum(np.minimum(view.angle, fastest / _GAIN), 2.0 * brake / _GAIN**2)  # rad, at the end
        slowed = np.maximum(fastest - _GAIN * linear, 0.0)
        coasted = view.angle + self._detour(view) - linear - slowed * (fastest + _GAIN * linear) / (2.0 * brake)
        begins = _BRAKING * fastest / (2.0 * brake)  # s, that gaining the rate costs
        ends = np.log(np.maximum(linear / self._close, 1.0)) / _GAIN
        return begins + np.maximum(coasted, 0.0) / fastest + slowed / brake + ends

    def spare_time(self, view: View, settle: float | np.ndarray, rolls: bool = True) -> np.ndarray:
        """s (N,) that are left of the gap at the next decision but for the way to the target, see `duration`.

        `settle` is how long before the opening the target is to be held, s.
        """
        return view.opens - self.period - settle - self.duration(view, rolls)

    def rolling_slew(self, view: View, settle: float | np.ndarray, side: np.ndarray) -> np.ndarray:
        """Actions (N, 3) towards the target at the fastest, and about the boresight.

        How the body is turned about the boresight is free: as long as there is time it turns as fast as the envelope
        leaves, times side (N,), within [-1, 1].
        """
        action = self.slew(view, self.fastest(view))
        turned = np.abs(self.boresight) > _ACROSS  # axes that a turn about the boresight turns
        room = ((view.most - np.abs(action))[:, turned] / np.abs(self.boresight[turned])).min(axis=1)
        roll = np.where(view.opens > settle + _UNROLL, side * np.maximum(room, 0.0), 0.0)
        return action + roll[:, None] * self.boresight

    def clear_of_sun(self, view: View, action: np.ndarray) -> np.ndarray:
        """Actions that do not bring the boresight nearer to the keep-out than it can be led along its edge."""
        if self._keep == 0.0:
            return action
        towards = np.cross(self.boresight, view.sun)
        sine = np.linalg.norm(towards, axis=1, keepdims=True)
        towards /= np.maximum(sine, 1e-9)  # a turn about it brings the boresight to the Sun
        distance = np.arctan2(sine[:, 0], view.sun @ self.boresight) - self._keep
        along = np.cross(towards, self.boresight)  # a turn about it goes round the Sun
        closing, passing = (self.limit * (action * axis).sum(axis=1) for axis in (towards, along))
        cut = np.maximum(closing - _EDGE_GAIN * distance, 0.0)
        known = view.sun.any(axis=1)
        led = action - (np.where(known, cut, 0.0) / self.limit)[:, None] * towards
        # what is cut goes on past the Sun, as far as the envelope allows
        more = np.sign(np.where(passing == 0.0, 1.0, passing)) * np.where(known, cut, 0.0) / self.limit
        led += more[:, None] * along
        return led / np.maximum(np.abs(led / np.maximum(view.most, 1e-9)).max(axis=1, keepdims=True), 1.0)

    def _detour(self, view: View) -> np.ndarray:
        """rad (N,) by which the way round the keep-out is longer than the shortest."""
        if self._keep == 0.0:
            return np.zeros(len(view.angle))
        off = np.arcsin(np.clip((view.axis * view.sun).sum(axis=1), -1.0, 1.0))  # of the Sun from the way's plane
        ahead = np.cross(view.axis, self.boresight)
        along = np.arctan2((ahead * view.sun).sum(axis=1), view.sun @ self.boresight)
        crosses = (along > 0.0) & (along < view.angle) & (np.abs(off) < self._keep)
        half = np.arccos(np.clip(np.cos(self._keep) / np.cos(off), -1.0, 1.0))  # of the way within the keep-out
        turned = np.arcsin(np.clip(np.sin(half) / np.sin(self._keep), -1.0, 1.0))
        return np.where(crosses, 2.0 * (turned * np.sin(self._keep) - half) + np.abs(self._keep - np.abs(off)), 0.0)


def _brake(mission: Mission) -> float:
    """rad/s^2, deceleration of a slew."""
    wheels = mission.satellite.wheels
    return _BRAKING * float((wheels.torque_reach / np.diag(mission.prior.inertia)).min())
