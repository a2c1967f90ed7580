"""Reference RateEKF: filterpy's algebra around the paper's model, written in plain numpy."""

from __future__ import annotations

from typing import Literal

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from satid_gym.estimators.filterpy.model import regressor, skew, tensor
from satid_gym.estimators.filterpy.momentum import Reference
from satid_gym.estimators.inertia import PARAMETER_COUNT, inertia_parameters
from satid_gym.estimators.prior import FilterPrior, estimated_parameters
from satid_gym.estimators.rate import RateEKFSettings


class FilterpyRateEKF(Reference):
    """RateEKF by filterpy's ExtendedKalmanFilter.

    Args:
        **settings: fields of `RateEKFSettings`.
    """

    coordinates: Literal["rate"] = "rate"
    settings: RateEKFSettings

    def __init__(self, **settings: object) -> None:
        super().__init__(RateEKFSettings.from_dict(settings))

    def reset(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        s, wheels = self.settings, prior.wheels
        parameters = estimated_parameters(s.parameters, prior)
        self.p, self.n = PARAMETER_COUNT[parameters], wheels.count
        self.spin = wheels.axes * wheels.inertia
        theta = inertia_parameters(prior.inertia, parameters)
        kf = self.filter = ExtendedKalmanFilter(dim_x=3 + self.p + self.n, dim_z=3 + self.n)
        kf.x = np.concatenate([gyro, theta, wheel_speed])
        counts = (3, self.p, self.n)
        prior_std = np.repeat([s.prior_rate_std, s.prior_inertia_std, s.prior_wheel_speed_std], counts)
        kf.P = np.diag(np.square(prior_std))
        kf.R = np.diag(np.square(np.repeat([s.gyro_std, s.wheel_speed_std], (3, self.n))))
        self.walk = np.repeat([s.rate_walk, s.inertia_walk, s.wheel_speed_walk], counts)
        self._speed = np.array(wheel_speed)

    def _slope(self, x: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        omega, theta, speed = x[:3], x[3 : 3 + self.p], x[3 + self.p :]
        inertia = tensor(theta)
        torque = -np.cross(omega, inertia @ omega + self.spin @ speed) - self.spin @ acceleration
        return np.concatenate([np.linalg.solve(inertia, torque), np.zeros(self.p), acceleration])

    def _slope_jacobian(self, x: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        omega, theta, speed = x[:3], x[3 : 3 + self.p], x[3 + self.p :]
        inertia, slope = tensor(theta), self._slope(x, acceleration)[:3]
        turn = skew(omega)
        by_omega = skew(inertia @ omega + self.spin @ speed) - turn @ inertia
        by_theta = -turn @ regressor(omega, self.p) - regressor(slope, self.p)
        jacobian = np.zeros((len(x), len(x)))
        jacobian[:3] = np.linalg.solve(inertia, np.hstack([by_omega, by_theta, -turn @ self.spin]))
        return jacobian

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        kf, x = self.filter, self.filter.x
        acceleration = (wheel_speed - self._speed) / dt
        kf.F = np.eye(len(x)) + dt * self._slope_jacobian(x, acceleration)
        kf.Q = np.diag(self.walk**2 * dt)
        kf.predict_x = lambda u: setattr(kf, "x", x + dt * self._slope(x, acceleration))
        kf.predict()
        self._speed = np.array(wheel_speed)

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Take in the reading; returns the normalised innovation squared per degree of freedom."""
        keep = np.r_[0:3, 3 + self.p : len(self.filter.x)]
        return self._condition(np.concatenate([gyro, wheel_speed]), keep, self.filter.R)

    def update_wheels(self, wheel_speed: np.ndarray) -> float:
        """Take in the tachometers' reading alone; returns its normalised innovation squared per degree of freedom."""
        return self._condition(wheel_speed, np.arange(3 + self.p, len(self.filter.x)), self.filter.R[3:, 3:])

    def _condition(self, reading: np.ndarray, keep: np.ndarray, noise: np.ndarray) -> float:
        kf = self.filter
        select = np.eye(len(kf.x))[keep]
        kf.update(reading, lambda x: select, lambda x: x[keep], R=noise)
        return float(kf.y @ kf.SI @ kf.y) / len(keep)
