"""The MomentumEKF's model in plain numpy: mean, Jacobians and noise, transcribed from the equations.

Apart from the core on purpose: the compiled filter is compared with filterpy's algebra around this.
"""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.inertia import PARAMETER_COUNT, PRODUCTS, inertia_parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior, estimated_parameters


def tensor(theta: np.ndarray) -> np.ndarray:
    """J (3, 3) of theta (p,)."""
    inertia = np.diag(theta[:3])
    for value, (i, j) in zip(theta[3:], PRODUCTS, strict=False):
        inertia[i, j] = inertia[j, i] = value
    return inertia


def regressor(omega: np.ndarray, count: int) -> np.ndarray:
    """L (3, p) with J omega = L theta."""
    columns = np.diag(omega)
    for i, j in PRODUCTS[: count - 3]:
        column = np.zeros(3)
        column[i], column[j] = omega[j], omega[i]
        columns = np.column_stack([columns, column])
    return columns


def skew(v: np.ndarray) -> np.ndarray:
    """[v x]."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


class MomentumModel:
    """Mean and Jacobians of x = [M, theta, tau]."""

    def __init__(self, settings: MomentumEKFSettings, prior: FilterPrior) -> None:
        self.settings, self.prior = settings, prior
        self.parameters = estimated_parameters(settings.parameters, prior)
        self.p = PARAMETER_COUNT[self.parameters]
        self.size = self.p + 6
        self.rate_coordinates = settings.updates_rate(prior)
        self.felt = np.eye(3)
        self.start_reference(np.zeros(3))
        wheels = prior.wheels
        self.spin = wheels.axes * wheels.inertia
        self.spin_covariance = self.spin @ self.spin.T * prior.tachometer_noise_std**2
        self.walk = np.concatenate(
            [
                np.zeros(3),
                settings.inertia_walk * prior.theta_scale(self.parameters),
                np.full(3, settings.torque_walk(prior)),
            ]
        )

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """M (3,), theta (p,) and tau (3,) of a state."""
        return x[:3], x[3 : 3 + self.p], x[3 + self.p : 6 + self.p]

    def input(self, wheel_speed: np.ndarray) -> np.ndarray:
        """Input of the model from wheel speeds (n,): a = A j Omega, (3,) N m s."""
        return self.spin @ wheel_speed

    def start(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance after the first reading: theta and tau at their priors, M as the reading says."""
        prior, parameters = self.prior, self.parameters
        mean = np.concatenate([np.zeros(3), inertia_parameters(prior.inertia, parameters), np.zeros(3)])
        std = [np.zeros(3), prior.prior_theta_std(parameters), np.full(3, prior.disturbance_std)]
        covariance = np.diag(np.concatenate(std) ** 2)
        self.start_momentum(mean, covariance, self.input(wheel_speed), gyro)
        return mean, covariance

    def start_momentum(self, x: np.ndarray, covariance: np.ndarray, a: np.ndarray, gyro: np.ndarray) -> None:
        """Write M = J omega + a of one reading, with what is known of theta and nothing of M before."""
        self.start_reference(gyro)
        inertia, regress = tensor(self.split(x)[1]), regressor(gyro, self.p)
        x[:3] = inertia @ gyro + a
        covariance[:3, 3:] = regress @ covariance[3 : 3 + self.p, 3:]
        covariance[3:, :3] = covariance[:3, 3:].T
        noise = inertia @ inertia * self.prior.gyro_noise_std**2 + self.spin_covariance
        covariance[:3, :3] = covariance[:3, 3 : 3 + self.p] @ regress.T + noise

    def start_reference(self, rate: np.ndarray) -> None:
        """Take a first rate (3,), rad/s, for the reference and its running mean."""
        self.reference, self.smoothed = rate.copy(), rate.copy()
        self.count, self.has_moved = np.ones(3), np.zeros(3, bool)

    @property
    def reference_state(self) -> tuple[np.ndarray, ...]:
        """Reference, its running mean, and what is counted of them, (3,) each."""
        return self.reference, self.smoothed, self.count, self.has_moved

    @reference_state.setter
    def reference_state(self, state: tuple[np.ndarray, ...]) -> None:
        self.reference, self.smoothed, self.count, self.has_moved = state

    def move_reference(self, likely: np.ndarray, spin: np.ndarray) -> None:
        """Move the reference to the most likely rate (3,), whose noise has the variances spin (3,).

        Where the change is more than noise at once, else to a running mean; until an axis has moved to the mean of its
        first 100 readings.
        """
        moved = (likely - self.reference) ** 2 > 50.0 * spin
        self.count = np.where(moved, 1.0, self.count + 1.0)
        self.smoothed = self.smoothed + np.maximum(1.0 / self.count, 0.1) * (likely - self.smoothed)
        begins = ~self.has_moved & ~moved & (self.count <= 100.0)
        mean = self.reference + (likely - self.reference) / self.count
        known = ~begins & ((self.smoothed - self.reference) ** 2 > 25.0 * (0.1 / 1.9 + 0.01) * spin)
        self.has_moved = self.has_moved | moved | known
        self.reference = np.where(begins, mean, np.where(self.has_moved, self.smoothed, self.reference))

    def inertia(self, x: np.ndarray) -> np.ndarray:
        """J (3, 3) of a state: what the body's rate carries."""
        return tensor(self.split(x)[1])

    def rate(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """omega = J^-1 (M - a), (3,) rad/s."""
        return np.linalg.solve(self.inertia(x), x[:3] - a)

    def reading(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Gyro reading that is expected, (3,) rad/s: the rate."""
        return self.rate(x, a)

    def spin_errors(self, x: np.ndarray, a: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """C (3, size) with J d omega = C dx at a state and the rate omega: d(M - a) - L(omega) dtheta."""
        return np.hstack([np.eye(3), -regressor(omega, self.p), np.zeros((3, 3))])

    def growth(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """What an update from one state to another does to errors, (size, size) and diagonal: nothing."""
        return np.eye(self.size)

    def gain_errors(self, omega: np.ndarray) -> np.ndarray:
        """dG omega of an error of the state, (3, size): none."""
        return np.zeros((3, self.size))

    def rate_jacobian(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Jacobian (3, size) of the rate."""
        return np.linalg.solve(self.inertia(x), self.spin_errors(x, a, self.rate(x, a)))

    def slope(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """dx/dt (size,): M x omega + tau, and nothing else moves by itself."""
        m, _, tau = self.split(x)
        return np.concatenate([np.cross(m, self.rate(x, a)) + tau, np.zeros(self.size - 3)])

    def slope_jacobian(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Its Jacobian (size, size)."""
        jacobian = np.zeros((self.size, self.size))
        m = x[:3]
        jacobian[:3] = skew(m) @ self.rate_jacobian(x, a)
        jacobian[:3, :3] -= skew(self.rate(x, a)) @ self.felt
        jacobian[:3, 3 + self.p : 6 + self.p] += np.eye(3)
        return jacobian

    def step(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        """A midpoint step of h seconds, along which A j Omega goes from a0 to a1."""
        middle = x + 0.5 * h * self.slope(x, a0)
        return x + h * self.slope(middle, 0.5 * (a0 + a1))

    def step_jacobian(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        """Its Jacobian (size, size)."""
        identity = np.eye(self.size)
        middle = x + 0.5 * h * self.slope(x, a0)
        inner = identity + 0.5 * h * self.slope_jacobian(x, a0)
        return identity + h * self.slope_jacobian(middle, 0.5 * (a0 + a1)) @ inner

    def process_noise(self, x: np.ndarray, a0: np.ndarray, h: float, dt: float) -> np.ndarray:
        """Random walks over h, and what tachometer noise does to M: h dt [M x] J^-1 N J^-1 [M x]^T."""
        noise = np.diag(self.walk**2 * h)
        middle = x + 0.5 * h * self.slope(x, a0)
        gain = skew(middle[:3]) @ np.linalg.inv(self.inertia(x))
        noise[:3, :3] += h * dt * gain @ self.spin_covariance @ gain.T
        return noise

    def nonlinearity(self, x: np.ndarray, covariance: np.ndarray, dt: float) -> np.ndarray:
        """What the Jacobian of a step leaves out, added to the covariance after it: nothing here."""
        return np.zeros_like(covariance)

    def measurement_jacobian(self, x: np.ndarray, a: np.ndarray, gyro: np.ndarray) -> np.ndarray:
        """Jacobian of the reading, its part by theta at the most likely rate."""
        return np.linalg.solve(self.inertia(x), self.spin_errors(x, a, self.likely_rate(x, a, gyro)))

    def likely_rate(self, x: np.ndarray, a: np.ndarray, gyro: np.ndarray) -> np.ndarray:
        """The rate that prediction and reading make most likely, (3,); 0 where that is within its noise.

        In rate coordinates, the reference, which follows it.
        """
        J_inv = np.linalg.inv(self.inertia(x))
        spin = J_inv @ self.spin_covariance @ J_inv
        noise = self.measurement_noise(x)
        likely = self.rate(x, a) + spin @ np.linalg.solve(noise, gyro - self.reading(x, a))
        if self.rate_coordinates:
            self.move_reference(likely, np.diag(spin))
            return self.reference
        likely[likely**2 <= 25.0 * np.diag(spin) * (1.0 - np.diag(spin) / np.diag(noise))] = 0.0
        return likely

    def iterations(self, x: np.ndarray, covariance: np.ndarray) -> int:
        """Updates are iterated while a moment is known to no better than 5 %."""
        std = np.sqrt(np.diag(covariance)[3:6])
        return 4 if np.any(std > 0.05 * x[3:6]) else 1

    def measurement_noise(self, x: np.ndarray) -> np.ndarray:
        """R (3, 3): the gyro's noise, and what the tachometers' does to the predicted rate."""
        J_inv = np.linalg.inv(self.inertia(x))
        return self.prior.gyro_noise_std**2 * np.eye(3) + J_inv @ self.spin_covariance @ J_inv
