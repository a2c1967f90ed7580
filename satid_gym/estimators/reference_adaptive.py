"""Reference AdaptiveEKF: filterpy's algebra, and the walk's estimation as its equations stand."""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.reference import FilterpyMomentumEKF
from satid_gym.estimators.settings import AdaptiveEKFSettings, Briefing


class FilterpyAdaptiveEKF(FilterpyMomentumEKF):
    """AdaptiveEKF by filterpy's ExtendedKalmanFilter; for the equations see `satid_gym.core.walk`.

    Args:
        **settings: fields of `AdaptiveEKFSettings`.
    """

    def __init__(self, **settings: object) -> None:
        self.adaptation = AdaptiveEKFSettings.from_dict(settings)
        super().__init__(**self.adaptation.momentum().to_dict())
        self.settings = self.adaptation

    def reset(self, briefing: Briefing, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        super().reset(briefing, gyro, wheel_speed)
        p = self.model.p
        self._scale = briefing.theta_scale(self.model.parameters)
        self._e, self._variance = self._parameter(self.adaptation.inertia_walk), 4.0
        self._theta_slope, self._covariance_slope = np.zeros(p), np.zeros((p, p))
        self.steps, self._since_step = 0, 30.0

    def _parameter(self, walk: float) -> float:
        relative = (walk / self.adaptation.least_walk) ** 2
        return float(np.log(relative)) if relative > 1.0 else relative - 1.0

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        e, least, p = self._e, self.adaptation.least_walk**2, self.model.p
        if e >= 0.0:
            q = slope = least * np.exp(e)
        else:
            q, slope = least * max(0.0, 1.0 + e * (1.0 + 2.0 * np.sqrt(self._variance))), least
        self.model.walk[3 : 3 + p] = np.sqrt(q) * self._scale
        self._covariance_slope = self._covariance_slope + np.diag(slope * self._scale**2 * dt)
        wander = self.adaptation.walk_drift * min(1.0, 1.0 + e) ** 2
        self._variance = min(self._variance + (wander + 0.002) * dt, 4.0)
        self._since_step += dt
        super().predict(wheel_speed, dt)

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Take in the reading; returns the normalised innovation squared per degree of freedom."""
        kf, theta = self.filter, slice(3, 3 + self.model.p)
        mean, covariance = kf.x.copy(), kf.P.copy()
        coarse = self.model.iterations(mean, covariance) > 1
        nis = super().update(gyro, wheel_speed)
        if not coarse and (3.0 * nis <= 40.0 or self._since_step < 30.0):
            self._learn(kf.x[theta] - mean[theta], covariance[theta, theta], kf.P[theta, theta])
            return nis
        if not coarse:
            covariance[theta, theta] += np.diag((0.1 * self._scale) ** 2)
            kf.x, kf.P = mean, covariance
            self.steps, self._since_step, self._variance = self.steps + 1, 0.0, 4.0
            nis = super().update(gyro, wheel_speed)
        self._theta_slope, self._covariance_slope = np.zeros(self.model.p), np.zeros((self.model.p,) * 2)
        return nis

    def _learn(self, moved: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        inverse = np.linalg.inv(before)
        u, w, t, d = inverse @ moved, inverse @ (before - after) @ inverse, self._theta_slope, self._covariance_slope
        score = u @ t + 0.5 * (u @ d @ u - np.trace(w @ d))
        information = t @ w @ t + 0.5 * np.trace(w @ d @ w @ d)
        kept = np.eye(len(moved)) - (before - after) @ inverse
        self._theta_slope, self._covariance_slope = kept @ (t + d @ u), kept @ d @ kept.T
        self._variance = 1.0 / (1.0 / self._variance + information)
        e = self._e + np.clip(self._variance * score, -2.0, 2.0)
        self._e = float(np.clip(e, -1.0, self._parameter(self.adaptation.most_walk)))
