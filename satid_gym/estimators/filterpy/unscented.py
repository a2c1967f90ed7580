"""Reference MomentumUKF: filterpy's unscented filter around the model of the MomentumEKF."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from satid_gym.estimators.filterpy.momentum import FilterpyMomentumEKF


class FilterpyMomentumUKF(FilterpyMomentumEKF):
    """The same model under filterpy's unscented filter: no Jacobians, curvature to second order.

    Args:
        **settings: fields of `MomentumEKFSettings`.

    Raises:
        ValueError: a gate or adaptation is asked for; this filter has none.
    """

    def __init__(self, **settings: object) -> None:
        super().__init__(**settings)
        if self.momentum.gate > 0.0 or self.momentum.adaptive:
            raise ValueError(
                "FilterpyMomentumUKF has neither gate nor adaptation: gate must be 0 and adaptive False, got "
                f"{self.momentum.gate} and {self.momentum.adaptive}"
            )

    def _new_filter(self) -> UnscentedKalmanFilter:
        size = self.model.size
        points = MerweScaledSigmaPoints(size, alpha=0.5, beta=2.0, kappa=3.0 - size, sqrt_method=_root)
        return UnscentedKalmanFilter(size, 3, dt=1.0, hx=self.model.reading, fx=self._step, points=points)

    def _step(self, x: np.ndarray, dt: float, a0: np.ndarray, a1: np.ndarray) -> np.ndarray:
        return self.model.step(x, a0, a1, dt)

    def _predict_step(self, a0: np.ndarray, a1: np.ndarray, h: float, dt: float) -> None:
        self.filter.Q = self.model.process_noise(self.filter.x, a0, h, dt)
        self.filter.predict(dt=h, a0=a0, a1=a1)

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Update with the reading; returns the normalised innovation squared per degree of freedom."""
        kf = self.filter
        kf.update(gyro, R=self.model.measurement_noise(kf.x), a=self._a)
        return float(kf.y @ kf.SI @ kf.y) / 3.0


def _root(matrix: np.ndarray) -> np.ndarray:
    """U with U^T U = matrix, for a matrix that may be only positive semidefinite, scaled to unit diagonal."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return (vectors * np.sqrt(np.maximum(values, 0.0))).T * scale
