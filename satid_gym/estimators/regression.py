"""A regression for the inertia, and its solutions: what all batch estimators share.

Every one of them writes the equation of motion as rows that are linear in the unknowns,

    design_k [theta, nuisance] = target_k + noise,

in units of momentum or of torque; they differ in the rows and in what they minimise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg
import scipy.optimize

from satid_gym.estimators.reference import tensor
from satid_gym.estimators.second_moment import (
    factor_bounds,
    factor_jacobian,
    from_factor,
    nearest_physical,
    to_factor,
)
from satid_gym.estimators.settings import PARAMETER_COUNT, Parameters

NAMES = ("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz")
LEAST_SIGNAL = 3.0  # rms of a regressor over its noise; below it that noise biases least squares by 10 %
MOST_STD = 0.25  # of a parameter relative to its prior scale; beyond it the data have not identified it


class NotIdentifiedError(ValueError):
    """The data say too little about some combination of the inertia parameters."""


@dataclass(frozen=True, eq=False, kw_only=True)
class InertiaFit:
    """A batch estimate of a constant inertia.

    Attributes:
        theta: (p,) kg m^2, body frame; physical.
        covariance: (p, p) of theta, from the scatter of the residuals; the physical constraint is not in it.
        rank: how many combinations of theta the data determine numerically; always p.
        condition: of the design, in units of noise and of the prior inertia, nuisances projected out.
        residual_std: of the residuals, in units of what the sensors' data sheets predict.
    """

    theta: np.ndarray
    covariance: np.ndarray
    rank: int
    condition: float
    residual_std: float

    @property
    def inertia(self) -> np.ndarray:
        """(3, 3) kg m^2."""
        return tensor(self.theta)


@dataclass(frozen=True, eq=False, kw_only=True)
class Regression:
    """Rows of one record.

    Attributes:
        design: (N, 3, p + q); q nuisance parameters come last.
        target: (N, 3).
        noise: (3, 3) covariance of a row.
        start: (p,) prior mean of theta, kg m^2.
        scale: (p,) size of its parameters, kg m^2.
        parameters: "principal" or "full".
    """

    design: np.ndarray
    target: np.ndarray
    noise: np.ndarray
    start: np.ndarray
    scale: np.ndarray
    parameters: Parameters

    @property
    def count(self) -> int:
        """p."""
        return PARAMETER_COUNT[self.parameters]

    def linear(self) -> InertiaFit:
        """Weighted least squares."""
        spectrum = self._spectrum(LEAST_SIGNAL)
        design, target = self._rows(self.design), self._rows(self.target[..., None])[:, 0]
        estimate = np.linalg.lstsq(design, target, rcond=None)[0]
        return self._conclude(estimate, design, target, np.linalg.pinv(design), spectrum)

    def instrumental(self, instruments: np.ndarray) -> InertiaFit:
        """Solution of Z^T (design x - target) = 0.

        Args:
            instruments: (N, 3, p + q), correlated with the design but not with its noise.
        """
        spectrum = self._spectrum(0.0)
        design, target = self._rows(self.design), self._rows(self.target[..., None])[:, 0]
        z = self._rows(instruments)
        try:
            inverse = np.linalg.solve(z.T @ design, z.T)
        except np.linalg.LinAlgError as error:
            raise NotIdentifiedError(
                "the instruments do not follow the motion, so they identify nothing; sample faster or move slower"
            ) from error
        return self._conclude(inverse @ target, design, target, inverse, spectrum)

    def nonlinear(self, weight: np.ndarray, loss: Literal["linear", "huber"], loss_scale: float = 1.0) -> InertiaFit:
        """Minimum of the residual J^-1 (design x - target), in units of rate or of its derivative.

        Bounded trust region over the factors of the second moment, so that every iterate is physical.

        Args:
            weight: (3, 3) square root of the residual's information.
            loss: "linear" for squares, "huber" for squares that turn linear.
            loss_scale: weighted residual at which they do.
        """
        rank, condition = self._spectrum(LEAST_SIGNAL)
        p = self.count
        residual, jacobian = self._residual(weight)
        low, high = factor_bounds(p)
        free = np.full(self.design.shape[2] - p, np.inf)
        rest = (self.target - self.design[:, :, :p] @ self.start).ravel()
        nuisance = np.linalg.lstsq(self.design[:, :, p:].reshape(len(rest), len(free)), rest, rcond=None)[0]
        result = scipy.optimize.least_squares(
            residual,
            np.concatenate([to_factor(self.start), nuisance]),
            jac=jacobian,
            bounds=(np.concatenate([low, -free]), np.concatenate([high, free])),
            x_scale="jac",
            loss=loss,
            f_scale=loss_scale,
            ftol=1e-12,
            xtol=1e-12,
            gtol=1e-15,
        )
        theta = from_factor(result.x[:p])
        jac = jacobian(result.x)
        jac[:, :p] = jac[:, :p] @ np.linalg.inv(factor_jacobian(result.x[:p]))
        errors = residual(result.x)
        weights = 1.0 if loss == "linear" else np.minimum(1.0, loss_scale / np.maximum(np.abs(errors), 1e-300))
        variance = np.sum(weights * errors**2) / (len(errors) - len(result.x))
        covariance = variance * np.linalg.inv(jac.T @ jac)[:p, :p]
        self._check_std(covariance)
        rows = self._rows((self.design @ np.concatenate([theta, result.x[p:]]) - self.target)[..., None])
        return InertiaFit(
            theta=theta,
            covariance=covariance,
            rank=rank,
            condition=condition,
            residual_std=float(np.sqrt(np.sum(rows**2) / (len(rows) - len(result.x)))),
        )

    def _residual(
        self, weight: np.ndarray
    ) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]:
        """Residual (3 N,) and Jacobian (3 N, p + q) by [entries of the second moment's factor, nuisance]."""
        p = self.count
        units = np.array([tensor(unit) for unit in np.eye(p)])

        def error(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            theta = from_factor(x[:p])
            flexibility = np.linalg.inv(tensor(theta))
            rows = self.design @ np.concatenate([theta, x[p:]]) - self.target
            return rows @ flexibility, weight @ flexibility

        def residual(x: np.ndarray) -> np.ndarray:
            return (error(x)[0] @ weight.T).ravel()

        def jacobian(x: np.ndarray) -> np.ndarray:
            errors, inverse = error(x)
            slope = self.design.copy()
            slope[:, :, :p] -= np.einsum("pij,nj->nip", units, errors)
            slope = inverse @ slope
            slope[:, :, :p] = slope[:, :, :p] @ factor_jacobian(x[:p])
            return slope.reshape(-1, len(x))

        return residual, jacobian

    def _rows(self, values: np.ndarray) -> np.ndarray:
        """(N, 3, m) as (3 N, m) rows of unit noise."""
        root = np.linalg.cholesky(self.noise)
        return np.linalg.solve(root, values).reshape(-1, values.shape[2])

    def _spectrum(self, least_signal: float) -> tuple[int, float]:
        """Rank and condition number of the design for theta.

        Raises:
            NotIdentifiedError: a combination of parameters has no more than `least_signal` times the noise.
        """
        rows = self._rows(self.design)
        theta, nuisance = rows[:, : self.count] * self.scale, rows[:, self.count :]
        if nuisance.shape[1]:
            basis = scipy.linalg.orth(nuisance)
            theta = theta - basis @ (basis.T @ theta)
        _, values, directions = np.linalg.svd(theta, full_matrices=False)
        numeric = values[0] * max(theta.shape) * np.finfo(float).eps
        least = max(numeric, least_signal * np.sqrt(len(self.design)))
        if values[-1] <= least:
            weakest = NAMES[int(np.abs(directions[-1]).argmax())]
            raise NotIdentifiedError(
                f"the data do not identify {weakest}: its regressor has an rms of "
                f"{values[-1] / np.sqrt(len(self.design)):.3g} times the sensors' noise, expected more than "
                f"{least / np.sqrt(len(self.design)):.3g}; turn the body more about that axis, or use principal "
                f"moments instead of the full tensor"
            )
        return int(np.sum(values > numeric)), float(values[0] / values[-1])

    def _conclude(
        self,
        estimate: np.ndarray,
        design: np.ndarray,
        target: np.ndarray,
        inverse: np.ndarray,
        spectrum: tuple[int, float],
    ) -> InertiaFit:
        """Fit of a linear estimate x = inverse (p + q, 3 N) target, made physical."""
        errors = design @ estimate - target
        variance = float(errors @ errors) / (len(errors) - len(estimate))
        spread = (inverse @ inverse.T)[: self.count, : self.count]
        self._check_std(variance * spread)
        return InertiaFit(
            theta=nearest_physical(estimate[: self.count], np.linalg.inv(spread)),
            covariance=variance * spread,
            rank=spectrum[0],
            condition=spectrum[1],
            residual_std=float(np.sqrt(variance)),
        )

    def _check_std(self, covariance: np.ndarray) -> None:
        std = np.sqrt(np.diag(covariance)) / self.scale
        if not std.max() <= MOST_STD:
            worst = int(np.nan_to_num(std, nan=np.inf).argmax())
            raise NotIdentifiedError(
                f"the data do not identify {NAMES[worst]}: its standard deviation is {std[worst]:.3g} of its prior "
                f"size, expected at most {MOST_STD}; turn the body more about that axis or record for longer"
            )
