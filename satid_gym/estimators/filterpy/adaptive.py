"""Reference AdaptiveEKF: filterpy's algebra, and the estimation of the process noise as its equations stand."""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.filterpy.momentum import FilterpyMomentumEKF
from satid_gym.estimators.prior import FilterPrior


class FilterpyAdaptiveEKF(FilterpyMomentumEKF):
    """AdaptiveEKF by filterpy's ExtendedKalmanFilter; for the equations see `satid_gym.core.belief.adaptation`.

    Args:
        **settings: fields of `MomentumEKFSettings`.
    """

    def __init__(self, **settings: object) -> None:
        super().__init__(**{"adaptive": True, **settings})

    def reset(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        super().reset(prior, gyro, wheel_speed)
        self._scale = prior.theta_scale(self.model.parameters)
        self._e, self._variance = self._log_q(self.momentum.inertia_walk), 4.0
        self.steps, self._since_step = 0, 30.0
        self._usual_age = 10.0
        self._forget()

    def _log_q(self, walk: float) -> float:
        relative = (walk / self.momentum.inertia_walk_min) ** 2
        return float(np.log(relative)) if relative > 1.0 else relative - 1.0

    def _forget(self) -> None:
        p, self._age = self.model.p, 0.0
        self._theta_slope, self._covariance_slope = np.zeros(p), np.zeros((p, p))

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        e, q_min, p = self._e, self.momentum.inertia_walk_min**2, self.model.p
        if e >= 0.0:
            q = slope = q_min * np.exp(e)
        else:
            q, slope = q_min * max(0.0, 1.0 + e * (1.0 + 2.0 * np.sqrt(self._variance))), q_min
        self._age += dt
        sure = np.clip(e - 2.0 * np.sqrt(self._variance), 0.0, 1.0)
        coherence = 1.0 + sure * max(2.0 * self._age / self._usual_age - 2.0, 0.0)
        q, slope = coherence * q, coherence * slope
        theta, own = self.filter.x[3 : 3 + p], 0.1 if p == 6 else 1.0
        self.model.walk[3 : 3 + p] = np.sqrt(own * q) * self._scale
        common = (1.0 - own) * np.outer(theta, theta)
        self.filter.P[3 : 3 + p, 3 : 3 + p] += q * common * dt
        self._covariance_slope = self._covariance_slope + slope * dt * (own * np.diag(self._scale**2) + common)
        drift = self.momentum.log_q_drift * min(1.0, 1.0 + e) ** 2
        self._variance = min(self._variance + (drift + 0.002) * dt, 4.0)
        self._since_step += dt
        super().predict(wheel_speed, dt)

    def _count_step(self) -> None:
        self._forget()
        self.steps, self._since_step, self._variance = self.steps + 1, 0.0, 4.0

    def _condition(self, gyro: np.ndarray) -> float:
        kf, theta = self.filter, slice(3, 3 + self.model.p)
        mean, covariance, reference = kf.x.copy(), kf.P.copy(), self.model.reference_state
        coarse = self.model.iterations(mean, covariance) > 1
        nis = super()._condition(gyro)
        if not coarse and (3.0 * nis <= 40.0 or self._since_step < 30.0):
            self._learn(kf.x[theta] - mean[theta], covariance[theta, theta], kf.P[theta, theta])
            return nis
        if not coarse:
            covariance[theta, theta] += np.diag((0.1 * self._scale) ** 2)
            kf.x, kf.P, self.model.reference_state = mean, covariance, reference
            self._stepped = True
            self._count_step()
            before, known = kf.x.copy(), kf.P.copy()
            nis = super()._condition(gyro)
            if self.model.iterations(before, known) == 1:
                self._learn(kf.x[theta] - before[theta], known[theta, theta], kf.P[theta, theta])
        else:
            self._forget()
        return nis

    def _learn(self, d: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        growth = self._growth  # the update scaled theta's errors by this; `learn` is in the errors before
        inverse, after = np.linalg.inv(before), after / np.outer(growth, growth)
        u, w, t, slope = inverse @ d, inverse @ (before - after) @ inverse, self._theta_slope, self._covariance_slope
        score = u @ t + 0.5 * (u @ slope @ u - np.trace(w @ slope))
        information = t @ w @ t + 0.5 * np.trace(w @ slope @ w @ slope)
        kept = np.eye(len(d)) - (before - after) @ inverse
        gain = 1.0 - np.trace(kept) / len(d)
        self._usual_age += 0.1 * gain * (self._age - self._usual_age)
        self._age *= 1.0 - gain
        self._theta_slope = growth * (kept @ (t + slope @ u))
        self._covariance_slope = np.outer(growth, growth) * (kept @ slope @ kept.T)
        self._variance = 1.0 / (1.0 / self._variance + information)
        e = self._e + np.clip(self._variance * score, -2.0, 2.0)
        self._e = float(np.clip(e, -1.0, self._log_q(self.momentum.inertia_walk_max)))
