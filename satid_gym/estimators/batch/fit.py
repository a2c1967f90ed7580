"""Fit of a batch estimator, and the error if there is no fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.estimators.inertia import inertia_tensors


class NotIdentifiedError(ValueError):
    """The data say too little about some combination of the inertia parameters."""


@dataclass(frozen=True, eq=False, kw_only=True)
class InertiaFit:
    """A batch estimate of a constant inertia.

    Attributes:
        theta: (p,) kg m^2, body frame; physical.
        covariance: (p, p) of theta, from the scatter of the residuals; the physical constraint is not in it.
        condition: of the design, in units of noise and of the prior inertia, nuisances projected out.
        residual_std: of the residuals, in units of what the sensors' data sheets predict.
    """

    theta: np.ndarray
    covariance: np.ndarray
    condition: float
    residual_std: float

    @property
    def inertia(self) -> np.ndarray:
        """(3, 3) kg m^2."""
        return inertia_tensors(self.theta)
