"""Model of the MomentumEKF with errors of gyro and wheels as states, transcribed from the equations."""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.calibration import calibration_covariance
from satid_gym.estimators.filterpy.model import MomentumModel, regressor, tensor
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior


class CalibratedModel(MomentumModel):
    """Mean and Jacobians of x = [M, theta, tau, b, G, e]; its input is the wheel speeds (n,), not A j Omega.

    Of b, G and e the state has what the prior's tolerances allow.
    """

    def __init__(self, settings: MomentumEKFSettings, prior: FilterPrior) -> None:
        super().__init__(settings, prior)
        self.rate_coordinates = True
        self.n = prior.wheels.count
        bias, gain, _, wheels = prior.tolerances.kinds
        self.kinds = bias, gain, wheels
        self.first = self.size
        self.size += prior.tolerances.states(self.n)
        self.walk = np.concatenate([self.walk, np.zeros(self.size - self.first)])
        if self.kinds[0]:
            self.walk[self.first : self.first + 3] = prior.gyro_bias_walk

    def errors(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """b (3,), G (3, 3) and e (3, n) of a state; 0 where it has none."""
        found, place = [], self.first
        for size, on in zip((3, 9, 3 * self.n), self.kinds, strict=True):
            found.append(x[place : place + size] if on else np.zeros(size))
            place += size if on else 0
        bias, gain, wheels = found
        return bias, gain.reshape(3, 3), wheels.reshape(self.n, 3).T

    def _columns(self, bias: np.ndarray, gain: np.ndarray, wheels: np.ndarray) -> np.ndarray:
        """Columns (3, c) of a Jacobian, of the errors that the state has."""
        parts = [part for part, on in zip((bias, gain, wheels), self.kinds, strict=True) if on]
        return np.hstack([np.zeros((3, 0)), *parts])

    def input(self, wheel_speed: np.ndarray) -> np.ndarray:
        """Wheel speeds as they are."""
        return wheel_speed

    def start(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance after the first reading: the errors at their prior too."""
        mean, covariance = np.zeros(self.size), np.zeros((self.size, self.size))
        simple = MomentumModel(self.settings, self.prior)
        mean[: simple.size], covariance[: simple.size, : simple.size] = simple.start(gyro, wheel_speed)
        covariance[self.first :, self.first :] = calibration_covariance(self.prior.wheels, self.prior.tolerances)
        self.start_momentum(mean, covariance, wheel_speed, gyro)
        return mean, covariance

    def start_momentum(self, x: np.ndarray, covariance: np.ndarray, a: np.ndarray, gyro: np.ndarray) -> None:
        """Write M = J omega + a of one reading, with what is known of theta and the errors."""
        bias, gain, wheels = self.errors(x)
        omega = np.linalg.solve(np.eye(3) + gain, gyro - bias)
        self.start_reference(omega)
        inertia = tensor(self.split(x)[1])
        x[:3] = inertia @ omega + (self.spin + wheels) @ a
        by_errors = self._columns(-inertia, -inertia @ np.kron(np.eye(3), omega), np.kron(a, np.eye(3)))
        rows = np.hstack([regressor(omega, self.p), np.zeros((3, self.first - 3 - self.p)), by_errors])
        covariance[:3, 3:] = rows @ covariance[3:, 3:]
        covariance[3:, :3] = covariance[:3, 3:].T
        noise = inertia @ inertia * self.prior.gyro_noise_std**2 + self.spin_covariance
        covariance[:3, :3] = covariance[:3, 3:] @ rows.T + noise

    def rate(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """omega = J^-1 (M - sum_k (j_k A_k + e_k) Omega_k), (3,) rad/s."""
        return super().rate(x, (self.spin + self.errors(x)[2]) @ a)

    def reading(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """(1 + G) omega + b, (3,) rad/s."""
        bias, gain, _ = self.errors(x)
        return (np.eye(3) + gain) @ self.rate(x, a) + bias

    def spin_errors(self, x: np.ndarray, a: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """C (3, size) with J d omega = C dx at a state and a rate: d(M - a) - L(omega) dtheta - sum_k Omega_k de_k."""
        by_errors = self._columns(np.zeros((3, 3)), np.zeros((3, 9)), -np.kron(a, np.eye(3)))
        others = np.zeros((3, self.first - 3 - self.p))
        return np.hstack([np.eye(3), -regressor(omega, self.p), others, by_errors])

    def growth(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """What an update from one state to another does to errors: those of theta stay what they are relative to it.

        Raises:
            ValueError: the update left a moment that is not positive.
        """
        grown = np.ones(self.size)
        if self.kinds[1] or self.kinds[2]:
            if np.any(after[3:6] <= 0.0):
                raise ValueError("an update left a moment that is not positive: use MomentumEKF, which shortens it")
            root = np.sqrt(after[3:6] / before[3:6])
            grown[3 : 3 + self.p] = inertia_parameters(np.outer(root, root), self.parameters)
        return np.diag(grown)

    def gain_errors(self, omega: np.ndarray) -> np.ndarray:
        """dG omega of an error of the state, (3, size)."""
        by_errors = self._columns(np.zeros((3, 3)), np.kron(np.eye(3), omega), np.zeros((3, 3 * self.n)))
        return np.hstack([np.zeros((3, self.first)), by_errors])

    def measurement_jacobian(self, x: np.ndarray, a: np.ndarray, gyro: np.ndarray) -> np.ndarray:
        """Jacobian of the reading, its part by theta and G at the most likely rate."""
        likely = self.likely_rate(x, a, gyro)
        by_errors = self._columns(np.eye(3), np.kron(np.eye(3), likely), np.zeros((3, 3 * self.n)))
        direct = np.hstack([np.zeros((3, self.first)), by_errors])
        by_rate = np.linalg.solve(self.inertia(x), self.spin_errors(x, a, likely))
        return (np.eye(3) + self.errors(x)[1]) @ by_rate + direct
