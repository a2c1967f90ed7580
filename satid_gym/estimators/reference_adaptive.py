"""Reference AdaptiveEKF: filterpy's IMMEstimator around its reference MomentumEKFs."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from filterpy.kalman import IMMEstimator

from satid_gym.estimators.reference import FilterpyMomentumEKF, Reference
from satid_gym.estimators.settings import AdaptiveEKFSettings, Briefing


class _Model:
    """A MomentumEKF with the names by which IMMEstimator calls a filter."""

    def __init__(self, ekf: FilterpyMomentumEKF) -> None:
        self._ekf = ekf
        self.nis = 0.0

    x = property(lambda self: self._ekf.filter.x, lambda self, x: setattr(self._ekf.filter, "x", x))
    P = property(lambda self: self._ekf.filter.P, lambda self, p: setattr(self._ekf.filter, "P", p))

    @property
    def likelihood(self) -> float:
        return self._ekf.filter.likelihood

    def predict(self, reading: tuple[np.ndarray, float]) -> None:
        self._ekf.predict(*reading)

    def update(self, reading: tuple[np.ndarray, np.ndarray]) -> None:
        self.nis = self._ekf.update(*reading)


class FilterpyAdaptiveEKF(Reference):
    """AdaptiveEKF by filterpy's IMMEstimator and ExtendedKalmanFilter.

    Args:
        **settings: fields of `AdaptiveEKFSettings`.
    """

    coordinates: Literal["momentum"] = "momentum"
    settings: AdaptiveEKFSettings

    def __init__(self, **settings: object) -> None:
        super().__init__(AdaptiveEKFSettings.from_dict(settings))

    def reset(self, briefing: Briefing, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        models: list[Any] = []
        for walk in self.settings.inertia_walks:
            ekf = FilterpyMomentumEKF(**self.settings.model(walk).to_dict())
            ekf.reset(briefing, gyro, wheel_speed)
            models.append(_Model(ekf))
        self.filter = IMMEstimator(models, np.ones(len(models)), np.eye(len(models)))

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        count, stay = self.filter.N, np.exp(-dt / self.settings.dwell)
        chances = stay * np.eye(count) + (1.0 - stay) / count
        # a new one each time: it thinks of the chances where it is made or updated, and not every step has an update
        self.filter = IMMEstimator(self.filter.filters, self.filter.mu, chances)
        self.filter.mu = self.filter.cbar.copy()  # by these weights the predictions are mixed
        self.filter.predict((wheel_speed, dt))

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Take in the reading; returns the models' mean normalised innovation squared per degree of freedom."""
        weights = self.filter.mu
        self.filter.update((gyro, wheel_speed))
        return float(weights @ [model.nis for model in self.filter.filters])
