"""Swings at full rate, with stops at which a star tracker for slow rates sees its stars.

A gyro whose scale is unknown tells a moment of inertia no better than its scale. The angle between two stops, which the
star tracker reads, tells both: the further the body has turned, the better. So the body swings as fast as it may, about
directions in which it has turned least so far, and stops where neither Sun nor Earth will be in the tracker's way, by
the observed directions of both. It waits for the readings that it stopped for, and goes on without them when the
tracker has had the time to acquire its stars and has not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.config import check_number
from satid_gym.control.rate_loop import RateMargin
from satid_gym.policy import Kind, Mission, check_commands_rates
from satid_gym.star_tracker import earth_angle

SIDES = np.array([[x, y, z] for x in (1.0, -1.0) for y in (1.0, -1.0) for z in (1.0, -1.0)])
"""(8, 3) rates to swing with, over their amplitudes."""
_LENGTHS = np.array([1.0, 1.5, 2.0])  # of a swing, over the usual one: more places to stop at
_SETTLED = 4.0  # time constants of the rate loop after which the body has stopped
_SAME = 1e-6  # within which two ages are one
NONE_YET = 1e-3  # rad^2, in which directions count as turned before any turn


class SwingAndStopPolicy:
    """Swings about changing directions and stops for the star tracker; for control "rate".

    Defaults of swing, look and amplitude are those that the gate of scenario "calibration" chose for microsat on tuning
    seeds.

    Args:
        swing: s at full rate; twice as long where that leads to a place from which stars are seen.
        look: decisions with readings that a stop lasts.
        clearance: rad that a stop keeps from the tracker's exclusions.
        amplitude: of the rates, over what the envelope allows.
        margin: see `RateMargin`.

    Raises:
        ValueError: a setting is out of range.
    """

    name = "swing_and_stop"
    kind: Kind = "closed_loop"
    observation = "body"

    def __init__(
        self,
        swing: float = 12.0,
        look: float = 4.0,
        clearance: float = 0.1,
        amplitude: float = 1.0,
        margin: float = 3.5,
    ) -> None:
        self.swing = check_number("swing", swing, strict=True)
        self.look = check_number("look", look)
        self.clearance = check_number("clearance", clearance)
        self.amplitude = check_number("amplitude", amplitude, high=1.0, strict=True)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or no star tracker is observed.
        """
        check_commands_rates(mission, self.name)
        if "attitude_age" not in mission.layout:
            raise ValueError(
                f"the attitude is not observed: swing_and_stop flies satellites with a star tracker, and "
                f'{mission.satellite.name!r} with this estimator observes none; scenario "calibration" has one'
            )
        tracker, world, n = mission.satellite.sensors.star_tracker, mission.scenario, len(seeds)
        assert tracker is not None
        self._allowed, self._layout = RateMargin([mission], self.margin), mission.layout
        self._boresight, period = tracker.boresight, world.decision_period
        self._exclusions = {}
        if tracker.sun_exclusion is not None:
            self._exclusions["sun"] = tracker.sun_exclusion
        if tracker.earth_exclusion is not None:
            self._exclusions["earth"] = earth_angle(world.orbit_rate) + tracker.earth_exclusion
        self._read_age = max(tracker.period, world.sample_period) / period + _SAME  # observed after a reading
        self._patience = (_SETTLED / world.tracking_bandwidth + tracker.reacquire) / period + self.look
        lengths = np.outer(np.broadcast_to(self.swing / period, n), _LENGTHS)
        self._lengths = np.maximum(np.round(lengths), 1.0)  # (N, 3) decisions
        self._amplitude, self._clearance = np.broadcast_to(self.amplitude, (n, 3)), np.broadcast_to(self.clearance, n)
        self._most = period * mission.satellite.rate_limit  # rad, turned in a decision at the limit
        self._preference = np.zeros((n, len(SIDES)))  # of a side, logarithm
        self._left = np.zeros(n)  # decisions of the swing that are left; 0: it stops
        self._waited = np.zeros(n)  # decisions of the stop
        self._seen = np.zeros(n) + self.look  # those of it with a reading; a flight begins with a swing
        self._side, self._turned = np.zeros((n, 3)), np.tile(NONE_YET * np.eye(3), (n, 1, 1))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        stops = self._left <= 0.0
        read = observation[:, self._layout["attitude_age"]][:, 0] <= self._read_age
        self._waited, self._seen = np.where(stops, self._waited + 1.0, 0.0), np.where(stops, self._seen + read, 0.0)
        for i in np.flatnonzero(stops & ((self._seen >= self.look) | (self._waited > self._patience))).tolist():
            self._swing(observation[i], i)
        self._left -= 1.0
        return self._allowed(observation, np.where(self._left[:, None] >= 0.0, self._side, 0.0))

    def _swing(self, observation: np.ndarray, i: int) -> None:
        """Begin a swing of episode i: to where stars are seen, as short as that allows, about what was turned least."""
        sides = self._amplitude[i] * SIDES
        turn = self._most * self._allowed(observation[None], np.ones(3))[0]
        turns = (self._lengths[i][:, None, None] * turn * sides).reshape(-1, 3)
        length, preference = np.repeat(self._lengths[i], len(SIDES)), np.tile(self._preference[i], len(_LENGTHS))
        axis = turns / np.linalg.norm(turns, axis=1, keepdims=True)
        sky = self._sky(observation)
        if self._exclusions and not sky:  # it may be blind for long: the boresight as far as it goes, the same way
            best = np.lexsort((np.abs(axis @ self._boresight), -length))[0]
        else:
            free = np.full(len(turns), self._clearance[i])
            for towards, exclusion in sky:
                there = Rotation.from_rotvec(turns).inv().apply(towards) @ self._boresight
                free = np.minimum(free, np.arccos(np.clip(there, -1.0, 1.0)) - exclusion)
            new = np.einsum("ni,ij,nj->n", axis, np.linalg.inv(self._turned[i]), axis)
            best = np.lexsort((-np.log(new) - preference, length, -free))[0]
        self._side[i], self._left[i] = sides[best % len(SIDES)], length[best]
        self._turned[i] += np.outer(turns[best], turns[best])
        self._waited[i] = self._seen[i] = 0.0

    def _sky(self, observation: np.ndarray) -> list[tuple[np.ndarray, float]]:
        """Unit vectors (3,) towards what blinds the tracker, body frame, with the angle; none before the attitude."""
        seen = [(observation[self._layout[name]].astype(float), angle) for name, angle in self._exclusions.items()]
        return [(towards / np.linalg.norm(towards), angle) for towards, angle in seen if towards.any()]
