"""Models of the MomentumEKF with the attitude's error as a state, of rigid and flexible bodies, from the equations."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.estimators.attitude import ATTITUDE_STD_MIN
from satid_gym.estimators.filterpy.calibration import CalibratedModel
from satid_gym.estimators.filterpy.flexible import COMPLEX_STEP, FlexibleModel
from satid_gym.estimators.filterpy.model import skew
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior
from satid_gym.tolerances import Tolerances

_KNOWN = 0.1  # rad, std about any axis beyond which the attitude begins again


class TrackedModel(CalibratedModel, ABC):
    """Base of both: x = [M, theta, tau, modes, psi, b, G, e], and the attitude that psi is the error of.

    Attributes:
        attitude: body to inertial; None before the first reading.
        offset: (3,) rad/s, how far the rate at which derivatives by theta are taken is from the filter's own.
    """

    def __init__(self, settings: MomentumEKFSettings, prior: FilterPrior) -> None:
        super().__init__(settings, prior if settings.calibrate else prior.replace(tolerances=Tolerances()))
        self.psi = slice(self.first, self.first + 3)
        self.walk = np.insert(self.walk, [self.first] * 3, 0.0)
        self.first, self.size = self.first + 3, self.size + 3
        self.attitude: Rotation | None = None
        self.offset = np.zeros(3)

    def begin_prediction(self, x: np.ndarray, a: np.ndarray, stepped: bool) -> None:
        """Note where derivatives are taken, before a prediction that begins with a state and wheel speeds (n,)."""
        self.offset = np.zeros(3) if stepped else self.reference - self.rate(x, a)

    @abstractmethod
    def turn(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> None:
        """Turn the attitude on by a step that begins with a state."""

    def is_known(self, covariance: np.ndarray) -> bool:
        """Whether it has begun, and its error is still a small angle."""
        return self.attitude is not None and bool((np.diag(covariance)[self.psi] < _KNOWN**2).all())

    def begin(self, covariance: np.ndarray, reading: Rotation) -> None:
        """Take a reading for the attitude, whose error has nothing to do with what was known before."""
        self.attitude = reading
        covariance[self.psi], covariance[:, self.psi] = 0.0, 0.0
        covariance[self.psi, self.psi] = self.tracker_noise()

    def tracker_noise(self) -> np.ndarray:
        """N (3, 3) of a reading, inertial frame, rad^2."""
        tracker = self.prior.sensors.star_tracker
        assert tracker is not None
        assert self.attitude is not None
        boresight = self.attitude.as_matrix() @ tracker.boresight
        along = np.outer(boresight, boresight)
        across, about = (max(std, ATTITUDE_STD_MIN) ** 2 for std in (tracker.across_std, tracker.round_std))
        return across * np.eye(3) + (about - across) * along

    def innovation(self, reading: Rotation) -> np.ndarray:
        """psi (3,) that a reading stands for: twice the sine of half its angle."""
        assert self.attitude is not None
        x, y, z, w = (reading * self.attitude.inv()).as_quat()
        return 2.0 * np.copysign(1.0, w) * np.array([x, y, z])

    def take_up(self, x: np.ndarray) -> None:
        """Move the mean of psi into the attitude."""
        if self.attitude is not None:
            self.attitude = Rotation.from_rotvec(x[self.psi]) * self.attitude
            x[self.psi] = 0.0


class AttitudeModel(TrackedModel):
    """Of a rigid body."""

    def step_jacobian(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        """Jacobian of a midpoint step (size, size): psi moves with the rate in its middle, d psi = h R d omega."""
        jacobian = super().step_jacobian(x, a0, a1, h)
        if self.attitude is not None:
            middle, a = x + 0.5 * h * self.slope(x, a0), 0.5 * (a0 + a1)
            omega = self.rate(middle, a)
            by_middle = np.linalg.solve(self.inertia(x), self.spin_errors(middle, a, omega + self.offset))
            by_start = by_middle @ (np.eye(self.size) + 0.5 * h * self.slope_jacobian(x, a0))
            turned = (self.attitude * Rotation.from_rotvec(0.5 * h * omega)).as_matrix()
            jacobian[self.psi] += h * turned @ by_start
        return jacobian

    def turn(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> None:
        """Turn the attitude on by a midpoint step that begins with a state."""
        if self.attitude is not None:
            omega = self.rate(x + 0.5 * h * self.slope(x, a0), 0.5 * (a0 + a1))
            self.attitude = self.attitude * Rotation.from_rotvec(h * omega)

    def process_noise(self, x: np.ndarray, a0: np.ndarray, h: float, dt: float) -> np.ndarray:
        """Random walks over h, and what tachometer noise does to M and psi alike; after the attitude has turned."""
        noise = super().process_noise(x, a0, h, dt)
        if self.attitude is not None:
            middle = x + 0.5 * h * self.slope(x, a0)
            to_psi = self.attitude.as_matrix() @ np.linalg.inv(self.inertia(x))
            noise[self.psi, self.psi] += h * dt * to_psi @ self.spin_covariance @ to_psi.T
            both = h * dt * skew(middle[:3]) @ np.linalg.inv(self.inertia(x)) @ self.spin_covariance @ to_psi.T
            noise[:3, self.psi], noise[self.psi, :3] = both, both.T
        return noise


class FlexibleAttitudeModel(TrackedModel, FlexibleModel):
    """Of a body with modes. The attitude turns with the rate in the middle of each Verlet step."""

    def __init__(self, settings: MomentumEKFSettings, prior: FilterPrior) -> None:
        super().__init__(settings, prior)
        self._passed: list[tuple[np.ndarray, np.ndarray, float]] = []

    def _pass(self, middle: np.ndarray, a: np.ndarray, h: float) -> None:
        self._passed.append((middle.copy(), a, h))

    def step_jacobian(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        """Jacobian of a step (size, size): psi moves with the rates on the way, d psi = sum h R d omega."""
        middles: list[list[np.ndarray]] = []
        jacobian = np.zeros((self.size, self.size))
        for j, unit in enumerate(np.eye(self.size)):
            self._passed = []
            jacobian[:, j] = self.step(x + 1j * COMPLEX_STEP * unit, a0, a1, h).imag / COMPLEX_STEP
            middles.append([middle.imag / COMPLEX_STEP for middle, _, _ in self._passed])
        if self.attitude is not None:
            turned = self.attitude
            for k, (middle, a, part) in enumerate(self._passed):
                point, by_start = middle.real, np.column_stack([column[k] for column in middles])
                omega = self.rate(point, a)
                rate = np.linalg.solve(self.inertia(point), self.spin_errors(point, a, omega + self.offset)) @ by_start
                jacobian[self.psi] += part * (turned * Rotation.from_rotvec(0.5 * part * omega)).as_matrix() @ rate
                turned = turned * Rotation.from_rotvec(part * omega)
        return jacobian

    def turn(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> None:
        """Turn the attitude on by a prediction that begins with a state."""
        self._passed = []
        self.step(x, a0, a1, h)
        for middle, a, part in self._passed:
            if self.attitude is not None:
                self.attitude = self.attitude * Rotation.from_rotvec(part * self.rate(middle, a))

    def by_rate(self, x: np.ndarray) -> np.ndarray:
        """What an error of the rate does in a second, (size, 3), to psi too; after the attitude has turned."""
        found = super().by_rate(x)
        if self.attitude is not None:
            found[self.psi] = self.attitude.as_matrix()
        return found
