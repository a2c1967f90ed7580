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

from satid_gym.estimators.batch.fit import InertiaFit, NotIdentifiedError
from satid_gym.estimators.batch.second_moment import (
    factor_bounds,
    factor_jacobian,
    from_factor,
    nearest_physical,
    to_factor,
)
from satid_gym.estimators.inertia import PARAMETER_COUNT, Parameters, inertia_tensors

NAMES = ("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz")
SIGNAL_MIN = 3.0  # rms of a regressor over its noise; below it that noise biases least squares by 10 %
STD_MAX = 0.25  # of a parameter relative to its prior scale; beyond it the data have not identified it


@dataclass(frozen=True, eq=False, kw_only=True)
class Regression:
    """Rows of one record.

    Attributes:
        design: (N, 3, p + q); q nuisance parameters come last.
        target: (N, 3).
        start: (p,) prior mean of theta, kg m^2.
        scale: (p,) size of its parameters, kg m^2.
        parameters: "principal" or "full".
        gyro_noise_std: rad/s, of a reading.
        wheel_noise: (3, 3) covariance of A j Omega, from the tachometers.
        noise_factor: noise variance of a row over that of J omega + A j Omega at one reading.
        dt: s between readings.
        attitude: (N, 3, 3) C of each row, where the nuisances are the momentum in inertial space; None else.
    """

    design: np.ndarray
    target: np.ndarray
    start: np.ndarray
    scale: np.ndarray
    parameters: Parameters
    gyro_noise_std: float
    wheel_noise: np.ndarray
    noise_factor: float
    dt: float
    attitude: np.ndarray | None = None

    @property
    def count(self) -> int:
        """p."""
        return PARAMETER_COUNT[self.parameters]

    def noise(self, theta: np.ndarray) -> np.ndarray:
        """Covariance (3, 3) of a row."""
        inertia = inertia_tensors(theta)
        return self.noise_factor * (self.gyro_noise_std**2 * inertia @ inertia + self.wheel_noise)

    def linear(self) -> InertiaFit:
        """Weighted least squares."""
        condition = self._condition(SIGNAL_MIN)
        design, target = self._rows(self.design), self._rows(self.target[..., None])[:, 0]
        return self._fit(
            np.linalg.lstsq(design, target, rcond=None)[0], self._per_row(np.linalg.pinv(design)), condition
        )

    def instrumental(self, instruments: np.ndarray) -> InertiaFit:
        """Solution of Z^T (design x - target) = 0.

        Args:
            instruments: (N, 3, p + q), correlated with the design but not with its noise.
        """
        condition = self._condition(0.0)
        design, target = self._rows(self.design), self._rows(self.target[..., None])[:, 0]
        z = self._rows(instruments)
        try:
            inverse = np.linalg.solve(z.T @ design, z.T)
        except np.linalg.LinAlgError as error:
            raise NotIdentifiedError(
                "the instruments do not follow the motion, so they identify nothing; sample faster or move slower"
            ) from error
        return self._fit(inverse @ target, self._per_row(inverse), condition)

    def nonlinear(self, weight: np.ndarray, loss: Literal["linear", "huber"], loss_scale: float = 1.0) -> InertiaFit:
        """Minimum of the residual J^-1 (design x - target), in units of rate or of its derivative.

        Bounded trust region over the factors of the second moment, so that every iterate is physical.

        Args:
            weight: (3, 3) square root of the residual's information.
            loss: "linear" for squares, "huber" for squares that turn linear.
            loss_scale: weighted residual at which they do.
        """
        condition = self._condition(SIGNAL_MIN)
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
        slope = jacobian(result.x)
        slope[:, :p] = slope[:, :p] @ np.linalg.inv(factor_jacobian(result.x[:p]))
        inverse = np.linalg.pinv(slope).reshape(slope.shape[1], -1, 3) @ weight @ np.linalg.inv(inertia_tensors(theta))
        return self._fit(np.concatenate([theta, result.x[p:]]), inverse, condition)

    def _residual(
        self, weight: np.ndarray
    ) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]:
        """Residual (3 N,) and Jacobian (3 N, p + q) by [entries of the second moment's factor, nuisance]."""
        p = self.count
        units = inertia_tensors(np.eye(p))

        def error(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            theta = from_factor(x[:p])
            J_inv = np.linalg.inv(inertia_tensors(theta))
            rows = self.design @ np.concatenate([theta, x[p:]]) - self.target
            return rows @ J_inv, weight @ J_inv

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

    def _rows(self, values: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """(N, 3, m) as (3 N, m) rows of unit noise, for the inertia theta (p,), by default the prior one."""
        root = np.linalg.cholesky(self.noise(self.start if theta is None else theta))
        return np.linalg.solve(root, values).reshape(-1, values.shape[2])

    def _condition(self, least_signal: float) -> float:
        """Condition number of the design for theta.

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
        return float(values[0] / values[-1])

    def _per_row(self, inverse: np.ndarray) -> np.ndarray:
        """(p + q, N, 3) of an inverse (p + q, 3 N) for rows of unit noise."""
        return inverse.reshape(len(inverse), -1, 3) @ np.linalg.inv(np.linalg.cholesky(self.noise(self.start)))

    def _fit(self, x: np.ndarray, inverse: np.ndarray, condition: float) -> InertiaFit:
        """Fit of unknowns x (p + q,) that follow the rows by `inverse` (p + q, N, 3), made physical."""
        errors = self._rows((self.design @ x - self.target)[..., None], x[: self.count])
        variance = float(np.sum(errors**2)) / (len(errors) - len(x))
        spread = self._spread(x, inverse[: self.count])
        self._check_std(variance * spread)
        return InertiaFit(
            theta=nearest_physical(x[: self.count], np.linalg.inv(spread)),
            covariance=variance * spread,
            condition=condition,
            residual_std=float(np.sqrt(variance)),
        )

    def _spread(self, x: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Covariance (p, p) of theta under the noise of the data sheets, by its gain (p, N, 3) on the rows.

        A gyro's noise n_j enters row j as J n_j and turns the attitude of every later row k by C_k^T C_j n_j dt,
        which moves that row by the momentum it carries, m_k = C_k^T M, crossed with the turn.
        """
        if self.attitude is None:
            return np.einsum("pki,ij,qkj->pq", gain, self.noise(x[: self.count]), gain)
        momentum = -self.design[:, :, self.count :] @ x[self.count :]
        crossed = np.cross(gain, momentum)  # g [m x] = -(m x g) = g x m
        inertial = np.einsum("pki,kji->pkj", crossed, self.attitude)
        later = np.cumsum(inertial[:, ::-1], axis=1)[:, ::-1]
        response = gain @ inertia_tensors(x[: self.count]) - self.dt * np.einsum("pkj,kji->pki", later, self.attitude)
        gyro = self.gyro_noise_std**2 * np.einsum("pki,qki->pq", response, response)
        return gyro + np.einsum("pki,ij,qkj->pq", gain, self.wheel_noise, gain)

    def _check_std(self, covariance: np.ndarray) -> None:
        std = np.sqrt(np.diag(covariance)) / self.scale
        if not std.max() <= STD_MAX:
            worst = int(np.nan_to_num(std, nan=np.inf).argmax())
            raise NotIdentifiedError(
                f"the data do not identify {NAMES[worst]}: its standard deviation is {std[worst]:.3g} of its prior "
                f"size, expected at most {STD_MAX}; turn the body more about that axis or record for longer"
            )
