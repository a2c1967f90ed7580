"""Gate of the reference MomentumEKF in plain numpy, transcribed from `satid_gym.core.belief.gating`."""

from __future__ import annotations

from typing import Any

import numpy as np

from satid_gym.estimators.filterpy.model import MomentumModel


class Gate:
    """Validation of the readings that FilterpyMomentumEKF uses.

    Args:
        model: of the filter.
        gyro, wheel_speed: (3,) and (n,) first readings, rad/s.

    Attributes:
        speed: (n,) wheel speeds that the filter uses, rad/s.
        torque: (n,) N m, commanded.
        coasting: whether no reading of the gyro has been accepted since the last prediction.
        confirmed: whether a reading has agreed with the one that M was started with.
        stepped: whether the last reading was accepted as a step of the inertia.
    """

    def __init__(self, model: MomentumModel, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        self.model, self.threshold = model, model.settings.gate_distance
        self.gyro, self.tachometer = np.array(gyro), np.array(wheel_speed)
        self.speed, self.torque = np.array(wheel_speed), np.zeros(len(wheel_speed))
        self.stuck = np.zeros(len(wheel_speed), bool)
        self.recovered = self.stuck.copy()
        self.coasting, self.confirmed, self.outage, self.silent = False, False, 0, 0
        self.rejections, self.since_rejection, self.stepped = 0, 0, False

    def look(self, wheel_speed: np.ndarray, dt: float) -> np.ndarray:
        """Gate the tachometers; returns what M and a gain (3,) from those that are back."""
        was, wheels = self.stuck, self.model.prior.wheels
        self.silent = self.silent + 1 if self.coasting else 0
        self.outage = self.outage + 1 if was.any() and self.coasting else self.outage if self.outage > 10 else 0
        self.stuck = (wheel_speed == self.tachometer) & (self.model.prior.tachometer_noise_std > 0.0)
        self.recovered = was & ~self.stuck
        unmeasured = wheels.axes[:, self.stuck]
        self.model.felt = np.eye(3) - unmeasured @ np.linalg.pinv(unmeasured)
        shift = self.model.spin[:, self.recovered] @ (wheel_speed - self.speed)[self.recovered]
        self.speed = np.where(self.stuck, self.speed + self.torque * dt / wheels.inertia, wheel_speed)
        self.tachometer = np.array(wheel_speed)
        self.coasting = True  # until a gyro reading is accepted
        self.since_rejection += 1
        return shift

    def freedom(self, momentum: np.ndarray, J_inv: np.ndarray, dt: float) -> np.ndarray:
        """(3, 3) covariance of what wheels without tachometer did to M - a."""
        wheels, total = self.model.prior.wheels, np.zeros((3, 3))
        for k in np.flatnonzero(self.stuck | self.recovered):
            axis = wheels.axes[:, k]
            way = axis + 0.5 * dt * np.cross(momentum, J_inv @ axis)
            total += (10.0 * wheels.max_torque[k] * dt) ** 2 * np.outer(way, way)
        return total

    def steps_unseen(self, dt: float) -> np.ndarray:
        """(p, p) covariance of the steps of theta that no reading would have shown."""
        variance = (0.1 * self.model.prior.theta_scale(self.model.parameters)) ** 2 * dt / 1800.0
        return np.diag(variance) if max(self.silent, self.outage) > 10 else np.zeros((self.model.p, self.model.p))

    def repeated(self, gyro: np.ndarray) -> bool:
        """Whether the gyro, which has noise, repeats itself."""
        same, self.gyro = bool((gyro == self.gyro).all()) and self.model.prior.gyro_is_noisy, np.array(gyro)
        self.coasting = same
        return same

    def momentum_lost(self) -> bool:
        """Whether nothing is known of M."""
        lost = self.outage > 10
        if not self.stuck.any():
            self.outage = 0
        return lost

    def reject(self, kf: Any, a: np.ndarray, gyro: np.ndarray) -> float | None:
        """Normalised innovation squared of a reading that is rejected, or 0; None where M is to be reinitialised.

        The third in a row is accepted.
        """
        self.stepped = False
        model, x = self.model, kf.x
        reference = model.reference_state
        innovation, slope = gyro - model.rate(x, a), model.measurement_jacobian(x, a, gyro)
        nis = float(innovation @ np.linalg.solve(slope @ kf.P @ slope.T + model.measurement_noise(x), innovation))
        if nis <= self.threshold:
            self.rejections, model.reference_state = 0, reference
            return 0.0
        if self.rejections == 0:
            self.since_rejection = 1
        self.rejections += 1
        if self.rejections < 3:
            self.coasting = True
            return nis
        self.rejections = 0
        if not self.confirmed:
            return None
        self.stepped, model.reference_state = True, reference
        return 0.0

    def take_step(self, kf: Any) -> None:
        """Raise the covariance for a step of theta that came with the first rejection."""
        p, steps = self.model.p, self.since_rejection * self.model.settings.steps(self.model.prior)
        way = np.vstack([steps * kf.F[:3, 3 : 3 + p], np.eye(p)])
        change = (0.1 * self.model.prior.theta_scale(self.model.parameters)) ** 2
        kf.P[: 3 + p, : 3 + p] += way * change @ way.T

    def attribute(self, change: np.ndarray) -> np.ndarray:
        """Take the part of an update of M (3,) along the axes of wheels without tachometer as theirs; its opposite."""
        wheels, shift = self.model.prior.wheels, np.zeros(3)
        for k in np.flatnonzero(self.stuck):
            spin = -wheels.axes[:, k] @ (change + shift)
            shift += spin * wheels.axes[:, k]
            self.speed[k] += spin / wheels.inertia[k]
        return shift
