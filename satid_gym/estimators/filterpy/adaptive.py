"""Reference AdaptiveEKF: filterpy's algebra, and the estimation of the process noise as its equations stand."""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.filterpy.gate import Gate
from satid_gym.estimators.filterpy.model import regressor
from satid_gym.estimators.filterpy.momentum import FilterpyMomentumEKF
from satid_gym.estimators.prior import FilterPrior


class FilterpyAdaptiveEKF(FilterpyMomentumEKF):
    """AdaptiveEKF by filterpy's ExtendedKalmanFilter.

    For the equations see `satid_gym.core.belief.adaptation` and `satid_gym.core.belief.inertia_step`.

    Args:
        **settings: fields of `MomentumEKFSettings`.
    """

    def __init__(self, **settings: object) -> None:
        super().__init__(**{"adaptive": True, **settings})

    def reset(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        super().reset(prior, gyro, wheel_speed)
        self._scale = prior.theta_scale(self.model.parameters)
        self._prior_theta = self.filter.x[3 : 3 + self.model.p].copy()
        self._e, self._variance = self._log_q(self.momentum.inertia_walk), 4.0
        self.steps, self._since_step = 0, 30.0
        self._settled, self._mean_innovation = np.zeros(3), np.zeros(3)
        self._conceals, self._concealed = 0.0, 0.0
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
        self._walk, self._age = np.sqrt(q), self._age + dt
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
        self._concealed += dt * (self._conceals - self._concealed / 60.0)
        rate = self.model.rate(self.filter.x, self._a)
        self._settled = self._settled + min(1.0, dt) * (rate - self._settled)
        super().predict(wheel_speed, dt)

    def _count_step(self) -> None:
        self._forget()
        self.steps, self._since_step, self._variance = self.steps + 1, 0.0, 4.0

    def _take_step(self, gate: Gate, gyro: np.ndarray) -> None:
        """Raise the covariance for a step of the inertia that a run of rejections, the last one `gyro`, shows."""
        if self._was_unseen(*self._whitened(gyro)):
            self._raise_unseen()
        else:
            super()._take_step(gate, gyro)
        self._count_step()

    def _condition(self, gyro: np.ndarray) -> float:
        kf, theta = self.filter, slice(3, 3 + self.model.p)
        mean, covariance, reference = kf.x.copy(), kf.P.copy(), self.model.reference_state
        coarse = self.model.iterations(mean, covariance) > 1
        slope, innovation = self._whitened(gyro)
        nis = super()._condition(gyro)
        if coarse:
            self._forget()
            return nis
        if 3.0 * nis > 40.0 and self._since_step >= 30.0:
            kf.x, kf.P, self.model.reference_state = mean, covariance, reference
            if self._was_unseen(slope, innovation):
                self._raise_unseen()
            else:
                kf.P[theta, theta] += np.diag((0.1 * self._scale) ** 2)
            self._stepped = True
            self._count_step()
            mean, covariance = kf.x.copy(), kf.P.copy()
            coarse = self.model.iterations(mean, covariance) > 1
            nis = super()._condition(gyro)
        self._mean_innovation = self._mean_innovation + 0.1 * (innovation - self._mean_innovation)
        self._conceals = float(np.sum(self._kept(slope) ** 2) < 40.0)
        if not coarse:
            self._learn(kf.x[theta] - mean[theta], covariance[theta, theta], kf.P[theta, theta])
        return nis

    def _whitened(self, gyro: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slope (3, size) and innovation (3,) of a gyro reading, in standard deviations of its noise."""
        model, x, a, reference = self.model, self.filter.x, self._a, self.model.reference_state
        root = np.linalg.cholesky(model.measurement_noise(x))
        slope, innovation = model.measurement_jacobian(x, a, gyro), gyro - model.reading(x, a)
        model.reference_state = reference
        return np.linalg.solve(root, slope), np.linalg.solve(root, innovation)

    def _was_unseen(self, slope: np.ndarray, innovation: np.ndarray) -> bool:
        """Whether the step that a reading shows may have come before it, so that M is off by L(rate of late) dtheta."""
        begins = self.steps == 0 and self._since_step < 60.0
        change = self.filter.x[3 : 3 + self.model.p] - self._prior_theta
        if begins or self._walk > 0.01 or self._concealed < 2.0 or np.any(np.abs(change) > 2.0 * self._scale):
            return False
        of_step = 0.1 * self._scale * slope[:, 3 : 3 + self.model.p] + self._kept(slope)
        expected = slope @ self.filter.P @ slope.T + np.eye(3) + of_step @ of_step.T
        grows = self._mean_innovation @ self._mean_innovation > 25.0 * 0.1 / 1.9
        plausible = innovation @ np.linalg.solve(expected, innovation) < 9.0
        return bool(plausible or grows)

    def _kept(self, slope: np.ndarray) -> np.ndarray:
        """(3, p) jump of a reading at steps of theta, where M stays."""
        return 0.1 * self._scale * (slope[:, :3] @ self._carried)

    @property
    def _carried(self) -> np.ndarray:
        return regressor(self._settled, self.model.p)

    def _raise_unseen(self) -> None:
        """Add a step of theta to the covariance, which M or the rate has kept, and what tau took up of it."""
        p, covariance = self.model.p, self.filter.P
        step, carried = np.diag((0.1 * self._scale) ** 2), self._carried
        covariance[3 : 3 + p, 3 : 3 + p] += step
        covariance[:3, 3 : 3 + p] += 0.5 * carried @ step
        covariance[3 : 3 + p, :3] += 0.5 * step @ carried.T
        covariance[:3, :3] += 0.5 * carried @ step @ carried.T
        covariance[3 + p : 6 + p, 3 + p : 6 + p] += self.model.prior.disturbance_std**2 * np.eye(3)

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
