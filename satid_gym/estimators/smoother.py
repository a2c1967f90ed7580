"""MomentumSmoother: the MomentumEKF run forward, then corrected backward by all that was measured later.

Rauch-Tung-Striebel, with the filter's own prediction m-, P- and Jacobian F from reading k to k + 1:

    G = P_k F^T (P-)^-1,  m_k += G (m_{k+1} - m-),  P_k += G (P_{k+1} - P-) G^T

For analysis after the fact: at reading k it knows the readings that follow.
Source: Rauch, Tung, Striebel, AIAA Journal 3(8), 1965; Sarkka, Bayesian Filtering and Smoothing (2013), ch. 9.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg

from satid_gym.config import check_number, real_array
from satid_gym.core import kernels
from satid_gym.estimators.compiled import FilterRun
from satid_gym.estimators.momentum import MomentumEKF, MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.records import new_belief, new_work


class MomentumSmoother:
    """Fixed-interval smoother of the MomentumEKF.

    Args:
        **settings: fields of `MomentumEKFSettings`.
    """

    def __init__(self, **settings: object) -> None:
        self.settings = MomentumEKFSettings.from_dict(settings)

    def run(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray, dt: float) -> FilterRun:
        """Smooth a whole series of readings.

        Args:
            prior: what is known before.
            gyro: (N, 3) rad/s.
            wheel_speed: (N, n) rad/s.
            dt: s between readings.

        Returns:
            Smoothed mean and covariance; `nis` and `constrained_updates` are the filter's.

        Raises:
            ValueError: a shape or a value is wrong, or the prior has tolerances or modes, which it does not smooth, or
                sensors whose readings are not of one instant, or `inflate` is set.
        """
        if self.settings.flexible and prior.modes:
            raise ValueError(
                "MomentumSmoother smooths no modes: give a prior without, or use flexible=False, which takes the body "
                "as rigid"
            )
        if prior.sensors.are_timed:
            raise ValueError(
                "MomentumSmoother takes gyro and tachometers as read at one instant: give a prior with sensors that "
                "neither integrate nor count, without delay"
            )
        if prior.sensors.star_tracker is not None:
            raise ValueError("MomentumSmoother takes no star tracker: give a prior whose sensors have none")
        if self.settings.calibrate and any(prior.tolerances.kinds):
            raise ValueError(
                "MomentumSmoother smooths no errors of sensors and wheels: give a prior without tolerances, or use "
                "calibrate=False, which takes sensors and wheels as nominal"
            )
        if self.settings.inflate:
            raise ValueError("MomentumSmoother takes the readings' noise as it is told: use inflate=False")
        forward = MomentumEKF(**self.settings.to_dict()).run(prior, gyro, wheel_speed, dt)
        return self.correct(forward, prior, wheel_speed, dt)

    def correct(self, forward: FilterRun, prior: FilterPrior, wheel_speed: np.ndarray, dt: float) -> FilterRun:
        """Smooth what a MomentumEKF of the same settings has filtered; arguments are those of `run`."""
        wheel_speed = real_array("wheel_speed", wheel_speed, (len(forward.mean), prior.wheels.count))
        transition = _Transition(prior, self.settings, check_number("dt", dt, strict=True))
        mean, covariance = forward.mean.copy(), forward.covariance.copy()
        for k in range(len(mean) - 2, -1, -1):
            ahead, spread, jacobian = transition(mean[k], covariance[k], wheel_speed[k], wheel_speed[k + 1])
            gain = _divide(covariance[k] @ jacobian.T, spread)
            mean[k] += gain @ (mean[k + 1] - ahead)
            corrected = covariance[k] + gain @ (covariance[k + 1] - spread) @ gain.T
            covariance[k] = 0.5 * (corrected + corrected.T)
        return dataclasses.replace(forward, mean=mean, covariance=covariance)


class _Transition:
    """The compiled filter's prediction between two readings, with its Jacobian."""

    def __init__(self, prior: FilterPrior, settings: MomentumEKFSettings, dt: float) -> None:
        # The filter leaves the Jacobian of its last substep only, so its substeps are taken one by one here;
        # its tachometer noise counts for the whole of dt, which the factor makes up for.
        self.steps = settings.steps(prior)
        self.h = dt / self.steps
        self.rows = new_belief(prior, settings)
        self.work = new_work(self.rows)
        self.rows["substeps"] = 1
        self.rows["wheel_momentum_covariance"] *= self.steps
        self.spin = prior.wheels.axes * prior.wheels.inertia

    def __call__(
        self, mean: np.ndarray, covariance: np.ndarray, before: np.ndarray, after: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted mean, covariance and Jacobian (size, size), from wheel speeds `before` to `after` (n,)."""
        row = self.rows[0]
        row["mean"], row["covariance"] = mean, covariance
        row["wheel_input"][:3] = self.spin @ before
        jacobian = np.eye(len(mean))
        for step in range(1, self.steps + 1):
            speed = before + (after - before) * step / self.steps
            kernels.predict_filter(self.rows, self.work, speed, self.h)
            jacobian[:3] = self.work["transition"][0, :3] @ jacobian
        return row["mean"].copy(), row["covariance"].copy(), jacobian


def _divide(matrix: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """matrix covariance^-1, by way of the correlation; a state without variance is certain and gets no gain."""
    std = np.sqrt(np.diag(covariance))
    certain = std == 0.0
    std = np.where(certain, 1.0, std)
    correlation = covariance / np.outer(std, std) + np.diag(certain.astype(float))
    return scipy.linalg.cho_solve(scipy.linalg.cho_factor(correlation), (matrix / std).T).T / std
