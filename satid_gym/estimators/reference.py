"""Reference filters: filterpy's algebra around the same models, written in plain numpy.

Slow and plain on purpose: they are what the compiled filters are held against, and a pattern for filters of
your own. The models are transcribed here from their equations, apart from the core.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import scipy.linalg
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from satid_gym.estimators.reference_gate import Vetting
from satid_gym.estimators.settings import (
    PARAMETER_COUNT,
    PRODUCTS,
    Briefing,
    MomentumEKFSettings,
    Parameters,
    RateEKFSettings,
    disturbance_walk,
    inertia_parameters,
)


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


class _MomentumModel:
    """Mean and Jacobians of x = [M, theta, tau]."""

    def __init__(self, settings: MomentumEKFSettings, briefing: Briefing) -> None:
        self.settings, self.briefing = settings, briefing
        self.p = PARAMETER_COUNT[settings.parameters]
        self.size = self.p + 6
        wheels = briefing.wheels
        self.spin = wheels.axes * wheels.inertia
        self.spin_covariance = self.spin @ self.spin.T * briefing.tachometer_noise_std**2
        self.walk = np.concatenate(
            [
                np.zeros(3),
                settings.inertia_walk * briefing.theta_scale(settings.parameters),
                np.full(3, disturbance_walk(settings, briefing)),
            ]
        )

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return x[:3], x[3 : 3 + self.p], x[3 + self.p :]

    def start(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        briefing = self.briefing
        theta = inertia_parameters(briefing.inertia, self.settings.parameters)
        inertia, regress = tensor(theta), regressor(gyro, self.p)
        mean = np.concatenate([inertia @ gyro + self.spin @ wheel_speed, theta, np.zeros(3)])
        prior = np.diag(briefing.prior_theta_std(self.settings.parameters) ** 2)
        moment = regress @ prior @ regress.T + inertia @ inertia * briefing.gyro_noise_std**2 + self.spin_covariance
        torque = np.eye(3) * briefing.disturbance_std**2
        covariance = scipy.linalg.block_diag(moment, prior, torque)
        covariance[:3, 3 : 3 + self.p] = regress @ prior
        covariance[3 : 3 + self.p, :3] = (regress @ prior).T
        return mean, covariance

    def rate(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        m, theta, _ = self.split(x)
        return np.linalg.solve(tensor(theta), m - a)

    def rate_jacobian(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        theta = self.split(x)[1]
        flexibility = np.linalg.inv(tensor(theta))
        by_theta = -flexibility @ regressor(self.rate(x, a), self.p)
        return np.hstack([flexibility, by_theta, np.zeros((3, 3))])

    def slope(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        m, _, tau = self.split(x)
        return np.concatenate([np.cross(m, self.rate(x, a)) + tau, np.zeros(self.p + 3)])

    def slope_jacobian(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        jacobian = np.zeros((self.size, self.size))
        m = x[:3]
        jacobian[:3] = skew(m) @ self.rate_jacobian(x, a)
        jacobian[:3, :3] -= skew(self.rate(x, a))
        jacobian[:3, -3:] += np.eye(3)
        return jacobian

    def step(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        middle = x + 0.5 * h * self.slope(x, a0)
        return x + h * self.slope(middle, 0.5 * (a0 + a1))

    def step_jacobian(self, x: np.ndarray, a0: np.ndarray, a1: np.ndarray, h: float) -> np.ndarray:
        identity = np.eye(self.size)
        middle = x + 0.5 * h * self.slope(x, a0)
        inner = identity + 0.5 * h * self.slope_jacobian(x, a0)
        return identity + h * self.slope_jacobian(middle, 0.5 * (a0 + a1)) @ inner

    def process_noise(self, x: np.ndarray, a0: np.ndarray, h: float, dt: float) -> np.ndarray:
        """Random walks over h, and what tachometer noise does to M: h dt [M x] J^-1 N J^-1 [M x]^T."""
        noise = np.diag(self.walk**2 * h)
        middle = x + 0.5 * h * self.slope(x, a0)
        gain = skew(middle[:3]) @ np.linalg.inv(tensor(self.split(x)[1]))
        noise[:3, :3] += h * dt * gain @ self.spin_covariance @ gain.T
        return noise

    def measurement_jacobian(self, x: np.ndarray, a: np.ndarray, gyro: np.ndarray) -> np.ndarray:
        """Jacobian of the rate, its part by theta at the most likely rate, and 0 where that is within its noise."""
        predicted, flexibility = self.rate(x, a), np.linalg.inv(tensor(self.split(x)[1]))
        spin = flexibility @ self.spin_covariance @ flexibility
        noise = self.measurement_noise(x)
        likely = predicted + spin @ np.linalg.solve(noise, gyro - predicted)
        likely[likely**2 <= 25.0 * np.diag(spin) * (1.0 - np.diag(spin) / np.diag(noise))] = 0.0
        return np.hstack([flexibility, -flexibility @ regressor(likely, self.p), np.zeros((3, 3))])

    def iterations(self, x: np.ndarray, covariance: np.ndarray) -> int:
        """Updates are iterated while a moment is known to no better than 5 %."""
        std = np.sqrt(np.diag(covariance)[3:6])
        return 4 if np.any(std > 0.05 * x[3:6]) else 1

    def measurement_noise(self, x: np.ndarray) -> np.ndarray:
        flexibility = np.linalg.inv(tensor(self.split(x)[1]))
        return self.briefing.gyro_noise_std**2 * np.eye(3) + flexibility @ self.spin_covariance @ flexibility


class _Reference:
    """What the reference filters share."""

    def __init__(self, settings: MomentumEKFSettings | RateEKFSettings) -> None:
        self.settings = settings
        self.filter: Any = None  # filterpy's, which carries no types

    @property
    def parameters(self) -> Parameters:
        """ "principal" or "full"."""
        return self.settings.parameters

    @property
    def mean(self) -> np.ndarray:
        """(size,) state."""
        return np.array(self.filter.x)

    @property
    def covariance(self) -> np.ndarray:
        """(size, size)."""
        return np.array(self.filter.P)


class FilterpyMomentumEKF(_Reference):
    """MomentumEKF by filterpy's ExtendedKalmanFilter.

    Args:
        **settings: fields of `MomentumEKFSettings`.
    """

    coordinates: Literal["momentum"] = "momentum"
    settings: MomentumEKFSettings

    def __init__(self, **settings: object) -> None:
        super().__init__(MomentumEKFSettings.from_dict(settings))

    def reset(self, briefing: Briefing, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        self.model = _MomentumModel(self.settings, briefing)
        self.filter = self._new_filter()
        self.filter.x, self.filter.P = self.model.start(gyro, wheel_speed)
        self._a = self.model.spin @ wheel_speed
        self._vetting = Vetting(self.model, gyro, wheel_speed) if self.settings.gate > 0.0 else None

    def command(self, torque: np.ndarray) -> None:
        """Take note of the motor torque (n,) commanded from now on, N m; wheels without tachometer follow it."""
        if self._vetting is not None:
            self._vetting.torque = np.array(torque)

    def _new_filter(self) -> ExtendedKalmanFilter:
        return ExtendedKalmanFilter(dim_x=self.model.size, dim_z=3)

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        vetting = self._vetting
        if vetting is not None:
            shift = vetting.look(wheel_speed, dt)
            self.filter.x[:3] += shift
            self._a = self._a + shift
            wheel_speed = vetting.speed
        start, end = self._a, self.model.spin @ wheel_speed
        steps = self.settings.substeps
        h = dt / steps
        for i in range(steps):
            a0, a1 = start + (end - start) * i / steps, start + (end - start) * (i + 1) / steps
            self._predict_step(a0, a1, h, dt)
        if vetting is not None:
            flexibility = np.linalg.inv(tensor(self.model.split(self.filter.x)[1]))
            self.filter.P[:3, :3] += vetting.freedom(self.filter.x[:3], flexibility, dt)
        self._a = end

    def _predict_step(self, a0: np.ndarray, a1: np.ndarray, h: float, dt: float) -> None:
        kf, x = self.filter, self.filter.x
        kf.F = self.model.step_jacobian(x, a0, a1, h)
        kf.Q = self.model.process_noise(x, a0, h, dt)
        kf.predict_x = lambda u: setattr(kf, "x", self.model.step(x, a0, a1, h))
        kf.predict()

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Take in the reading; returns the normalised innovation squared per degree of freedom."""
        kf, vetting = self.filter, self._vetting
        if vetting is None:
            return self._condition(gyro)
        if vetting.repeated(gyro):
            return 0.0
        refused = None if vetting.lost() else vetting.refuse(kf, self._a, gyro)
        if refused is None:
            self._start_momentum(gyro)
            vetting.vouched = False
            return 0.0
        if refused > 0.0:
            return refused / 3.0
        vetting.vouched = True
        before = kf.x[:3].copy()
        nis = self._condition(gyro)
        shift = vetting.attribute(kf.x[:3] - before)
        kf.x[:3] += shift
        self._a = self._a + shift
        return nis

    def _start_momentum(self, gyro: np.ndarray) -> None:
        """M = J omega + a, with what is known of theta and nothing of M before."""
        x, covariance, p = self.filter.x, self.filter.P, self.model.p
        inertia, regress = tensor(x[3 : 3 + p]), regressor(gyro, p)
        x[:3] = inertia @ gyro + self._a
        covariance[:3, 3:] = regress @ covariance[3 : 3 + p, 3:]
        covariance[3:, :3] = covariance[:3, 3:].T
        noise = inertia @ inertia * self.model.briefing.gyro_noise_std**2 + self.model.spin_covariance
        covariance[:3, :3] = covariance[:3, 3 : 3 + p] @ regress.T + noise

    def _condition(self, gyro: np.ndarray) -> float:
        kf, model, a = self.filter, self.model, self._a
        prior, covariance = kf.x.copy(), kf.P.copy()
        for _ in range(model.iterations(prior, covariance)):
            point = kf.x.copy()
            slope, value = model.measurement_jacobian(point, a, gyro), model.rate(point, a)
            noise = model.measurement_noise(point)
            kf.x, kf.P = prior.copy(), covariance.copy()
            kf.update(gyro, lambda x, s=slope: s, lambda x, s=slope, v=value, c=point: v + s @ (x - c), R=noise)
        return float(kf.y @ kf.SI @ kf.y) / 3.0


class FilterpyMomentumUKF(FilterpyMomentumEKF):
    """The same model under filterpy's unscented filter: no Jacobians, curvature to second order.

    Args:
        **settings: fields of `MomentumEKFSettings`.

    Raises:
        ValueError: a gate is asked for; this filter has none.
    """

    def __init__(self, **settings: object) -> None:
        super().__init__(**settings)
        if self.settings.gate > 0.0:
            raise ValueError(f"FilterpyMomentumUKF has no gate: it must be 0, got {self.settings.gate}")

    def _new_filter(self) -> UnscentedKalmanFilter:
        size = self.model.size
        points = MerweScaledSigmaPoints(size, alpha=0.5, beta=2.0, kappa=3.0 - size, sqrt_method=_root)
        return UnscentedKalmanFilter(size, 3, dt=1.0, hx=self.model.rate, fx=self._step, points=points)

    def _step(self, x: np.ndarray, dt: float, a0: np.ndarray, a1: np.ndarray) -> np.ndarray:
        return self.model.step(x, a0, a1, dt)

    def _predict_step(self, a0: np.ndarray, a1: np.ndarray, h: float, dt: float) -> None:
        self.filter.Q = self.model.process_noise(self.filter.x, a0, h, dt)
        self.filter.predict(dt=h, a0=a0, a1=a1)

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Take in the reading; returns the normalised innovation squared per degree of freedom."""
        kf = self.filter
        kf.update(gyro, R=self.model.measurement_noise(kf.x), a=self._a)
        return float(kf.y @ kf.SI @ kf.y) / 3.0


def _root(matrix: np.ndarray) -> np.ndarray:
    """U with U^T U = matrix, for a matrix that may be only positive semidefinite, scaled to unit diagonal."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return (vectors * np.sqrt(np.maximum(values, 0.0))).T * scale


class FilterpyRateEKF(_Reference):
    """RateEKF by filterpy's ExtendedKalmanFilter.

    Args:
        **settings: fields of `RateEKFSettings`.
    """

    coordinates: Literal["rate"] = "rate"
    settings: RateEKFSettings

    def __init__(self, **settings: object) -> None:
        super().__init__(RateEKFSettings.from_dict(settings))

    def reset(self, briefing: Briefing, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        s, wheels = self.settings, briefing.wheels
        self.p, self.n = PARAMETER_COUNT[s.parameters], wheels.count
        self.spin = wheels.axes * wheels.inertia
        theta = inertia_parameters(briefing.inertia, s.parameters)
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
        kf = self.filter
        keep = np.r_[0:3, 3 + self.p : len(kf.x)]
        select = np.eye(len(kf.x))[keep]
        kf.update(np.concatenate([gyro, wheel_speed]), lambda x: select, lambda x: x[keep])
        return float(kf.y @ kf.SI @ kf.y) / len(keep)
