"""The gate of the reference MomentumEKF, in plain numpy; see `satid_gym.core.vetting`, which this transcribes."""

from __future__ import annotations

from typing import Any

import numpy as np

from satid_gym.estimators.reference_model import MomentumModel
from satid_gym.estimators.settings import gate_distance


class Vetting:
    """Which readings FilterpyMomentumEKF believes.

    Args:
        model: of the filter.
        gyro, wheel_speed: (3,) and (n,) first readings, rad/s.

    Attributes:
        speed: (n,) wheel speeds to go by, rad/s.
        torque: (n,) N m, commanded.
        vouched: whether a reading has agreed with the one that M was started with.
    """

    def __init__(self, model: MomentumModel, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        self.model, self.gate = model, gate_distance(model.settings)
        self.gyro, self.tachometer = np.array(gyro), np.array(wheel_speed)
        self.speed, self.torque = np.array(wheel_speed), np.zeros(len(wheel_speed))
        self.dead = np.zeros(len(wheel_speed), bool)
        self.back = self.dead.copy()
        self.unread, self.vouched, self.refusals, self.blind = False, False, 0, 0

    def look(self, wheel_speed: np.ndarray, dt: float) -> np.ndarray:
        """Take in the tachometers; returns what M and a gain (3,) from those that are back."""
        was, wheels = self.dead, self.model.briefing.wheels
        self.blind = self.blind + 1 if was.any() and self.unread else self.blind if self.blind > 10 else 0
        self.dead = (wheel_speed == self.tachometer) & (self.model.briefing.tachometer_noise_std > 0.0)
        self.back = was & ~self.dead
        shift = self.model.spin[:, self.back] @ (wheel_speed - self.speed)[self.back]
        self.speed = np.where(self.dead, self.speed + self.torque * dt / wheels.inertia, wheel_speed)
        self.tachometer = np.array(wheel_speed)
        self.unread = True  # until a gyro reading is believed
        return shift

    def freedom(self, momentum: np.ndarray, flexibility: np.ndarray, dt: float) -> np.ndarray:
        """(3, 3) covariance of what wheels without tachometer did to M - a."""
        wheels, total = self.model.briefing.wheels, np.zeros((3, 3))
        for k in np.flatnonzero(self.dead | self.back):
            axis = wheels.axes[:, k]
            way = axis + 0.5 * dt * np.cross(momentum, flexibility @ axis)
            total += (10.0 * wheels.max_torque[k] * dt) ** 2 * np.outer(way, way)
        return total

    def repeated(self, gyro: np.ndarray) -> bool:
        """Whether the gyro repeats itself."""
        same, self.gyro = bool((gyro == self.gyro).all()), np.array(gyro)
        self.unread = same
        return same

    def lost(self) -> bool:
        """Whether nothing is known of M."""
        lost = self.blind > 10
        if not self.dead.any():
            self.blind = 0
        return lost

    def refuse(self, kf: Any, a: np.ndarray, gyro: np.ndarray) -> float | None:
        """Normalised innovation squared of a reading that is refused, or 0; None where M is to be started anew.

        The third in a row is not refused.
        """
        model, x = self.model, kf.x
        innovation, slope = gyro - model.rate(x, a), model.measurement_jacobian(x, a, gyro)
        nis = float(innovation @ np.linalg.solve(slope @ kf.P @ slope.T + model.measurement_noise(x), innovation))
        if nis <= self.gate:
            self.refusals = 0
            return 0.0
        self.refusals += 1
        if self.refusals < 3:
            self.unread = True
            return nis
        p, steps = model.p, self.refusals * model.settings.substeps
        self.refusals = 0
        if not self.vouched:
            return None
        way = np.vstack([steps * kf.F[:3, 3 : 3 + p], np.eye(p)])
        change = (0.1 * model.briefing.theta_scale(model.settings.parameters)) ** 2
        kf.P[: 3 + p, : 3 + p] += way * change @ way.T
        return 0.0

    def attribute(self, change: np.ndarray) -> np.ndarray:
        """Take the part of an update of M (3,) along the axes of wheels without tachometer as theirs; its opposite."""
        wheels, shift = self.model.briefing.wheels, np.zeros(3)
        for k in np.flatnonzero(self.dead):
            spin = -wheels.axes[:, k] @ (change + shift)
            shift += spin * wheels.axes[:, k]
            self.speed[k] += spin / wheels.inertia[k]
        return shift
