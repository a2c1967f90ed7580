"""Model of the MomentumEKF with modes as states, transcribed from the equations; its Jacobian by complex steps."""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.calibration import calibration_covariance
from satid_gym.estimators.filterpy.calibration import CalibratedModel
from satid_gym.estimators.filterpy.model import skew, tensor
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior
from satid_gym.tolerances import Tolerances

COMPLEX_STEP = 1e-30


class FlexibleModel(CalibratedModel):
    """Mean and Jacobians of x = [M, theta, tau, modes, b, G, e]; its input is the wheel speeds (n,).

    A mode has eta, p, log w, log |d| and log zeta. The Jacobian of a step is exact to rounding: its imaginary part is
    where a state gets an imaginary one.
    Source: Squire and Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998).
    """

    def __init__(self, settings: MomentumEKFSettings, prior: FilterPrior) -> None:
        super().__init__(settings, prior if settings.calibrate else prior.replace(tolerances=Tolerances()))
        self.modes, self.first_mode = prior.modes, self.first
        states = 5 * len(prior.modes)
        self.walk = np.insert(self.walk, [self.first] * states, 0.0)
        self.first, self.size = self.first + states, self.size + states

    def mode(self, x: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (5,) of mode i, its d (3,) and its D (3, 3)."""
        own = x[self.first_mode + 5 * i : self.first_mode + 5 * i + 5]
        mode, scale = self.modes[i], np.exp(own[3])
        return own, scale * mode.coupling, scale * mode.inertia_slope

    def inertia(self, x: np.ndarray) -> np.ndarray:
        """J + dJ - sum d d^T."""
        inertia = tensor(self.split(x)[1])
        for i, mode in enumerate(self.modes):
            (eta, *_), d, slope = self.mode(x, i)
            inertia = inertia + slope * eta + mode.inertia_curvature * eta**2 - np.outer(d, d)
        return inertia

    def carried(self, x: np.ndarray) -> np.ndarray:
        """sum d p, (3,) N m s."""
        found = np.zeros(3)
        for i in range(len(self.modes)):
            own, d, _ = self.mode(x, i)
            found = found + d * own[1]
        return found

    def rate(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """omega of a state and wheel speeds, (3,) rad/s."""
        spin = (self.spin + self.errors(x)[2]) @ a
        return np.linalg.solve(self.inertia(x), x[:3] - spin - self.carried(x))

    def spin_errors(self, x: np.ndarray, a: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """C (3, size): also -d dp - dJ'(eta) omega deta - (d (deta/dt - d . omega) + D eta omega) dlog |d|."""
        columns = super().spin_errors(x, a, omega)
        for i, mode in enumerate(self.modes):
            (eta, p, *_), d, slope = self.mode(x, i)
            at = self.first_mode + 5 * i
            columns[:, at] = -(slope + 2.0 * eta * mode.inertia_curvature) @ omega
            columns[:, at + 1] = -d
            columns[:, at + 3] = -d * (p - 2.0 * d @ omega) - slope @ omega * eta
        return columns

    def start(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance after the first reading: the modes at rest against the body."""
        prior, first = self.prior, self.first_mode
        mean, variance = np.zeros(self.size), np.zeros(self.size)
        mean[3 : 3 + self.p] = inertia_parameters(prior.inertia, self.parameters)
        variance[3 : 3 + self.p] = prior.prior_theta_std(self.parameters) ** 2
        variance[3 + self.p : first] = prior.disturbance_std**2
        covariance = np.diag(variance)
        errors = prior.tolerances if any(self.kinds) else Tolerances()
        covariance[self.first :, self.first :] = calibration_covariance(prior.wheels, errors)
        rate_variance = prior.gyro_noise_std**2 + errors.gyro_bias**2
        for i, mode in enumerate(self.modes):
            at, rate = first + 5 * i, 2.0 * np.pi * mode.frequency
            along = mode.coupling @ gyro
            std = [
                mode.deflection_std,
                rate * mode.deflection_std,
                mode.frequency_std,
                mode.coupling_std,
                mode.damping_std,
            ]
            covariance[at : at + 5, at : at + 5] = np.diag(np.square(std))
            by_error = np.array([0.0, along, 0.0, 1.0, 0.0])
            covariance[at + 3, at + 3] = 0.0
            covariance[at : at + 5, at : at + 5] += mode.coupling_std**2 * np.outer(by_error, by_error)
            covariance[at + 1, at + 1] += rate_variance * mode.coupling @ mode.coupling
            mean[at + 1] = along
        self.start_momentum(mean, covariance, wheel_speed, gyro)
        return mean, covariance

    def start_momentum(self, x: np.ndarray, covariance: np.ndarray, a: np.ndarray, gyro: np.ndarray) -> None:
        """Write M of one reading, with what is known of theta, the modes and the errors."""
        bias, gain, wheels = self.errors(x)
        omega = np.linalg.solve(np.eye(3) + gain, gyro - bias)
        self.start_reference(omega)
        inertia = self.inertia(x)
        x[:3] = inertia @ omega + (self.spin + wheels) @ a + self.carried(x)
        rows = -self.spin_errors(x, a, omega)
        by_errors = self._columns(-inertia, -inertia @ np.kron(np.eye(3), omega), np.kron(a, np.eye(3)))
        rows[:, self.first :] = by_errors
        covariance[:3, 3:] = rows[:, 3:] @ covariance[3:, 3:]
        covariance[3:, :3] = covariance[:3, 3:].T
        noise = inertia @ inertia * self.prior.gyro_noise_std**2 + self.spin_covariance
        covariance[:3, :3] = covariance[:3, 3:] @ rows[:, 3:].T + noise

    def step(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        """A prediction of h seconds, in Verlet steps of at most 0.2 rad of the fastest mode."""
        J_inv, fastest = np.linalg.inv(self.inertia(x).real), 0.0
        for i, mode in enumerate(self.modes):
            own, d, _ = self.mode(x.real, i)
            held = 2.0 * np.pi * mode.frequency * np.exp(own[2])
            fastest = max(fastest, float(held * np.sqrt(1.0 + d @ J_inv @ d)))
        steps = max(1, int(np.ceil(fastest * h / 0.2)))
        x = x.copy()
        for k in range(steps):
            middle = a0 + (a1 - a0) * (k + 0.5) / steps
            x = self._verlet(x, a0 + (a1 - a0) * k / steps, middle, h / steps)
        return x

    def _verlet(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        tau = x[3 + self.p : 6 + self.p]
        early = self.rate(x, a0)
        middle = x + 0.5 * h * self._pushes(x, early)
        middle[:3] = x[:3] + 0.5 * h * (np.cross(x[:3], early) + tau)
        self._pass(middle, a1, h)
        omega = self.rate(middle, a1)
        for i in range(len(self.modes)):
            own, d, _ = self.mode(middle, i)
            middle[self.first_mode + 5 * i] += h * (own[1] - d @ omega)
        end = middle + 0.5 * h * self._pushes(middle, omega)
        end[:3] = x[:3] + h * (np.cross(middle[:3], omega) + tau)
        return end

    def _pass(self, middle: np.ndarray, a: np.ndarray, h: float) -> None:
        """Take note of the middle of a step of h seconds; a: the input (n,) there, wheel speeds."""

    def _pushes(self, x: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """dp/dt of the modes, (size,)."""
        found = np.zeros_like(x)
        for i, mode in enumerate(self.modes):
            (eta, p, log_w, _, log_zeta), d, slope = self.mode(x, i)
            w, zeta = 2.0 * np.pi * mode.frequency * np.exp(log_w), mode.damping * np.exp(log_zeta)
            rotation = omega @ (0.5 * slope + eta * mode.inertia_curvature) @ omega
            found[self.first_mode + 5 * i + 1] = -(w**2) * eta - 2.0 * zeta * w * (p - d @ omega) + rotation
        return found

    def step_jacobian(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        """Its Jacobian (size, size)."""
        shifted = x + 1j * COMPLEX_STEP * np.eye(self.size)
        return np.column_stack([self.step(row, a0, a1, h).imag / COMPLEX_STEP for row in shifted])

    def process_noise(self, x: np.ndarray, a0: np.ndarray, h: float, dt: float) -> np.ndarray:
        """Random walks over h, and what tachometer noise does to M and to eta."""
        gain = self.by_rate(x) @ np.linalg.inv(self.inertia(x))
        return np.diag(self.walk**2 * h) + h * dt * gain @ self.spin_covariance @ gain.T

    def by_rate(self, x: np.ndarray) -> np.ndarray:
        """What an error of the rate does in a second, (size, 3)."""
        found = np.zeros((self.size, 3))
        found[:3] = skew(x[:3])
        for i in range(len(self.modes)):
            found[self.first_mode + 5 * i] = -self.mode(x, i)[1]
        return found

    def nonlinearity(self, x: np.ndarray, covariance: np.ndarray, dt: float) -> np.ndarray:
        """Second-order terms of a coarsely known frequency, and what of it fades."""
        found = np.zeros_like(covariance)
        for i, mode in enumerate(self.modes):
            at, w = self.first_mode + 5 * i, 2.0 * np.pi * mode.frequency * np.exp(self.mode(x, i)[0][2])
            ee, ww, ew = covariance[at, at], covariance[at + 2, at + 2], covariance[at, at + 2]
            grown = min(8.0 * w * (ee * ww + ew**2), ee)
            found[at + 1, at + 1] = w**2 * dt * (grown + 16.0 * w * (x[at] * ww) ** 2)
            found[at + 2, at + 2] = min(0.05 * w * dt * ww, max(mode.frequency_std**2 - ww, 0.0))
        return found
