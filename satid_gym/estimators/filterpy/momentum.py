"""Reference MomentumEKF: filterpy's algebra around the same model, in plain numpy.

Slow and plain on purpose: the compiled filters are compared with them, and they are a pattern for filters of your own.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.spatial.transform import Rotation

from satid_gym.estimators.filterpy.attitude import AttitudeModel, FlexibleAttitudeModel, TrackedModel
from satid_gym.estimators.filterpy.calibration import CalibratedModel
from satid_gym.estimators.filterpy.flexible import FlexibleModel
from satid_gym.estimators.filterpy.gate import Gate
from satid_gym.estimators.filterpy.model import MomentumModel, tensor
from satid_gym.estimators.inertia import Parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.settings import EstimatorSettings


class Reference:
    """Base of the reference filters."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self.settings = settings
        self.filter: Any = None  # filterpy's, which carries no types

    @property
    def parameters(self) -> Parameters | None:
        """ "principal", "full", or None: what the prior needs."""
        return self.settings.parameters

    @property
    def mean(self) -> np.ndarray:
        """(size,) state."""
        return np.array(self.filter.x)

    @property
    def covariance(self) -> np.ndarray:
        """(size, size)."""
        return np.array(self.filter.P)


class FilterpyMomentumEKF(Reference):
    """MomentumEKF without adaptation by filterpy's ExtendedKalmanFilter.

    It never inflates: with modes it is the MomentumEKF with `inflate=False`.

    Args:
        **settings: fields of `MomentumEKFSettings`.

    Raises:
        ValueError: adaptation is asked for.
    """

    coordinates: Literal["momentum"] = "momentum"

    def __init__(self, **settings: object) -> None:
        self.momentum = MomentumEKFSettings.from_dict(settings)
        super().__init__(self.momentum)
        if self.momentum.adaptive and type(self) is FilterpyMomentumEKF:
            raise ValueError("FilterpyMomentumEKF has no adaptation: use FilterpyAdaptiveEKF, or adaptive=False")
        if self.momentum.inflate:
            raise ValueError(f"{type(self).__name__} does not inflate: use MomentumEKF, or inflate=False")
        self._gate: Gate | None = None

    def reset(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        self.model = self._new_model(prior)
        self.filter = self._new_filter()
        self.filter.x, self.filter.P = self.model.start(gyro, wheel_speed)
        self._a = self.model.input(wheel_speed)
        self._stepped = False
        self._gate = Gate(self.model, gyro, wheel_speed) if self.momentum.gate > 0.0 else None

    def command(self, torque: np.ndarray) -> None:
        """Note the motor torque (n,) commanded from now on, N m; wheels without tachometer are assumed to follow it."""
        if self._gate is not None:
            self._gate.torque = np.array(torque)

    @property
    def accepted(self) -> tuple[bool, np.ndarray] | None:
        """Whether the last gyro reading was accepted, and the wheel speeds (n,) used; None without a gate."""
        return None if self._gate is None else (not self._gate.coasting, self._gate.speed.copy())

    def _new_model(self, prior: FilterPrior) -> MomentumModel:
        if prior.sensors.are_timed:
            raise ValueError(
                f"{type(self).__name__} takes gyro and tachometers as read at one instant: use MomentumEKF, or sensors "
                "that neither integrate nor count, without delay"
            )
        calibrates, flexible = self.momentum.calibrate and any(prior.tolerances.kinds), self.momentum.flexible
        if self.momentum.gate > 0.0 and (calibrates or (flexible and prior.modes)):
            raise ValueError(
                "the gate of FilterpyMomentumEKF knows exact wheels and rigid bodies alone: use gate=0, or "
                "calibrate=False and flexible=False"
            )
        if prior.sensors.star_tracker is not None:
            if type(self) is not FilterpyMomentumEKF or self.momentum.gate > 0.0:
                raise ValueError(
                    "of the reference filters FilterpyMomentumEKF takes a star tracker, without gate: use MomentumEKF, "
                    "or sensors without star_tracker"
                )
            return (FlexibleAttitudeModel if flexible and prior.modes else AttitudeModel)(self.momentum, prior)
        if flexible and prior.modes:
            return FlexibleModel(self.momentum, prior)
        return CalibratedModel(self.momentum, prior) if calibrates else MomentumModel(self.momentum, prior)

    def _new_filter(self) -> ExtendedKalmanFilter:
        return ExtendedKalmanFilter(dim_x=self.model.size, dim_z=3)

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        gate = self._gate
        if gate is not None:
            shift = gate.look(wheel_speed, dt)
            self.filter.x[:3] += shift
            self._a = self._a + shift
            wheel_speed = gate.speed
        start, end = self._a, self.model.input(wheel_speed)
        steps = self.momentum.steps(self.model.prior)
        h = dt / steps
        if isinstance(self.model, TrackedModel):
            self.model.begin_prediction(self.filter.x, start, self._stepped)
        for i in range(steps):
            a0, a1 = start + (end - start) * i / steps, start + (end - start) * (i + 1) / steps
            self._predict_step(a0, a1, h, dt)
        if gate is not None:
            J_inv = np.linalg.inv(tensor(self.model.split(self.filter.x)[1]))
            self.filter.P[:3, :3] += gate.freedom(self.filter.x[:3], J_inv, dt)
            theta = slice(3, 3 + self.model.p)
            self.filter.P[theta, theta] += gate.steps_unseen(dt)
        self._a = end

    def _predict_step(self, a0: np.ndarray, a1: np.ndarray, h: float, dt: float) -> None:
        kf, x = self.filter, self.filter.x
        kf.F = self.model.step_jacobian(x, a0, a1, h)
        if isinstance(self.model, TrackedModel):
            self.model.turn(x, a0, a1, h)
        kf.Q = self.model.process_noise(x, a0, h, dt)
        kf.predict_x = lambda u: setattr(kf, "x", self.model.step(x, a0, a1, h))
        kf.predict()
        kf.P += self.model.nonlinearity(kf.x, kf.P, dt)

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Update with the reading; returns the normalised innovation squared per degree of freedom."""
        kf, gate = self.filter, self._gate
        if gate is None:
            nis = self._condition(gyro)
            if isinstance(self.model, TrackedModel):
                self.model.take_up(kf.x)
            return nis
        if gate.repeated(gyro):
            return 0.0
        rejected = None if gate.momentum_lost() else gate.reject(kf, self._a, gyro)
        if rejected is None:
            self.model.start_momentum(kf.x, kf.P, self._a, gyro)
            gate.confirmed, gate.rejections = False, 0
            return 0.0
        if rejected > 0.0:
            return rejected / 3.0
        gate.confirmed = True
        if gate.stepped:
            self._stepped = True
            self._take_step(gate, gyro)
        before = kf.x[:3].copy()
        nis = self._condition(gyro)
        shift = gate.attribute(kf.x[:3] - before)
        kf.x[:3] += shift
        self._a = self._a + shift
        return nis

    def _take_step(self, gate: Gate, gyro: np.ndarray) -> None:
        """Raise the covariance for a step of the inertia that a run of rejections, the last one `gyro`, shows."""
        gate.take_step(self.filter)

    def _condition(self, gyro: np.ndarray) -> float:
        kf, model, a = self.filter, self.model, self._a
        self._growth = np.ones(model.p)
        if np.all(np.sqrt(np.diag(kf.P)[3:6]) <= 0.01 * kf.x[3:6]):
            self._stepped = False
        prior, covariance = kf.x.copy(), kf.P.copy()
        iterations = model.iterations(prior, covariance)
        for i in range(iterations):
            point = kf.x.copy()
            slope, value = model.measurement_jacobian(point, a, gyro), model.reading(point, a)
            noise = model.measurement_noise(point)
            in_rate = i == 0 and model.rate_coordinates and not self._stepped
            if in_rate and (iterations == 1 or not self._is_nonlinear(slope, gyro - value, noise)):
                return self._update_rate(gyro, slope, value, noise)
            kf.x, kf.P = prior.copy(), covariance.copy()
            kf.update(gyro, lambda x, s=slope: s, lambda x, s=slope, v=value, c=point: v + s @ (x - c), R=noise)
        return float(kf.y @ kf.SI @ kf.y) / 3.0

    def _is_nonlinear(self, slope: np.ndarray, innovation: np.ndarray, noise: np.ndarray) -> bool:
        """Whether one linear update leaves a moment with an error beyond the std that it leaves."""
        x, covariance = self.filter.x, self.filter.P
        gain = covariance @ slope.T @ np.linalg.inv(slope @ covariance @ slope.T + noise)
        error, left = (gain @ innovation)[3:6] ** 2 / x[3:6], np.diag(covariance - gain @ slope @ covariance)[3:6]
        return bool((error**2 > left).any())

    def update_attitude(self, attitude: np.ndarray) -> float:
        """Update with a reading (4,) of the star tracker, body to inertial, scalar last; NIS per degree of freedom.

        Raises:
            ValueError: the prior has no star tracker.
        """
        kf, model, reading = self.filter, self.model, Rotation.from_quat(attitude)
        if not isinstance(model, TrackedModel):
            raise ValueError("update_attitude is for a prior whose sensors have a star_tracker")
        if not model.is_known(kf.P):
            model.begin(kf.P, reading)
            return 0.0
        slope = np.zeros((3, model.size))
        slope[:, model.psi] = np.eye(3)
        nis = self._update_rate(model.innovation(reading), slope, np.zeros(3), model.tracker_noise())
        model.take_up(kf.x)
        return nis

    def _update_rate(self, reading: np.ndarray, slope: np.ndarray, value: np.ndarray, noise: np.ndarray) -> float:
        """Update in errors of the rate by a reading, its slope (3, size), expectation and noise; M follows."""
        kf, model, a = self.filter, self.model, self._a
        x = kf.x.copy()
        omega = model.rate(x, a)
        kf.update(reading, lambda _: slope, lambda _: value, R=noise)
        to_rate = np.linalg.solve(model.inertia(x), model.spin_errors(x, a, model.reference))
        correction = to_rate @ (kf.x - x)
        before, inertia, identity = model.inertia(x), model.inertia(kf.x), np.eye(model.size)
        carried = before @ (omega - model.reference) + inertia @ (model.reference + correction)
        model.reference, model.smoothed = model.reference + correction, model.smoothed + correction
        grown = model.growth(x, kf.x)
        identity[:3] = inertia @ to_rate + (identity[:3] - model.spin_errors(kf.x, a, model.reference)) @ grown
        identity[:3] -= inertia @ model.gain_errors(correction)
        identity[3:] = grown[3:]
        kf.P = identity @ kf.P @ identity.T
        self._growth = np.diag(grown)[3 : 3 + model.p]
        kf.x[:3] += carried - inertia @ model.rate(kf.x, a)
        return float(kf.y @ kf.SI @ kf.y) / 3.0
