"""Posterior bound: Tichavsky's recursion for the MomentumEKF's model along true trajectories,

    I' = (Q + F I^-1 F^T)^-1 + H^T R^-1 H,

F, H, Q and R at the true state: the filter's own Riccati equation with the truth in the place of the estimate.
Two averages over episodes: `population_bound` takes the mean of theta's information, which is never below
Tichavsky's bound for the population; the mean of `episode_bounds` is by Jensen's inequality not below that, and
is what an efficient filter reaches, for it knows from its readings how much each episode tells.

Source: Tichavsky, Muravchik and Nehorai, IEEE Trans. Signal Processing 46 (1998).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from satid_gym.bounds.motion import TrueMotion
from satid_gym.core.algebra import add_diagonal, congruence, inverse, load, load_symmetric, store_symmetric
from satid_gym.core.belief import momentum_filter, momentum_model, momentum_start
from satid_gym.core.belief.kalman import estimated_inertia, update, write_times_regressor
from satid_gym.core.jit import inline, kernel
from satid_gym.estimators.inertia import PRODUCTS, inertia_parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior, estimated_parameters
from satid_gym.estimators.records import new_belief, new_work
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances


def posterior_bound(
    motion: TrueMotion, prior: FilterPrior, settings: MomentumEKFSettings, dt: float, *, law_known: bool = False
) -> np.ndarray:
    """Bound on theta's covariance (N, T, p, p) of each episode, kg^2 m^4.

    Sensors and wheels are taken as nominal: where they are not, no filter reaches it. So is the body
    as rigid: of one with oscillators, whose momentum is in the motion's, it is no bound.

    Args:
        motion: the truth.
        prior: sensors and prior.
        settings: the model: principal or full parameters, and the walks.
        dt: s between two instants.
        law_known: the filter knows by what factor each parameter changes from instant to instant, and only
            its size is unknown; with `inertia_walk` 0, what a filter that knew the law could reach.

    Raises:
        ValueError: the law is to be known and takes a product of inertia through zero.
    """
    parameters = estimated_parameters(settings.parameters, prior)
    theta = inertia_parameters(motion.inertia, parameters)
    growth = growth_factors(theta, law_known)
    prior = prior.replace(gyro_noise_std=prior.reading_std, sensors=Sensors(), tolerances=Tolerances())
    belief = new_belief(prior, settings.replace(calibrate=False, flexible=False, rate_coordinates=False))
    out = np.empty((*theta.shape, theta.shape[2]))
    series = (motion.momentum, motion.rate, motion.wheel_speed, motion.torque, theta, growth)
    bound_many(belief, new_work(belief), _Series(*map(np.ascontiguousarray, series)), dt, out)
    return out


class _Series(NamedTuple):
    """Truth of N episodes at T instants: see `TrueMotion`; theta and its growth (N, T, p)."""

    momentum: np.ndarray
    rate: np.ndarray
    wheel_speed: np.ndarray
    torque: np.ndarray
    theta: np.ndarray
    growth: np.ndarray


def growth_factors(theta: np.ndarray, law_known: bool) -> np.ndarray:
    """Factors (N, T, p) from the instant before; 1 where the law is not known."""
    return law_growth(theta) if law_known else np.ones_like(theta)


def law_growth(theta: np.ndarray) -> np.ndarray:
    """Factors (N, T, p) by which parameters theta (N, T, p) grow from the previous instant.

    A product of inertia that stays 0 is given the factor that one about the same axes has where all of J grows alike.

    Raises:
        ValueError: a product of inertia passes through zero.
    """
    growth = np.ones_like(theta)
    growth[:, 1:, :3] = theta[:, 1:, :3] / theta[:, :-1, :3]
    for k, (i, j) in enumerate(PRODUCTS[: theta.shape[2] - 3], start=3):
        before, now = theta[:, :-1, k], theta[:, 1:, k]
        absent = (before == 0.0) & (now == 0.0)
        if not np.all(absent | (before * now > 0.0)):
            raise ValueError(
                f"a known law is a factor on each parameter, and J{'xyz'[i]}{'xyz'[j]} passes through zero: "
                'it needs parameters "principal", or a law that keeps the sign of products of inertia'
            )
        alike = np.sqrt(growth[:, 1:, i] * growth[:, 1:, j])
        growth[:, 1:, k] = np.where(absent, alike, now / np.where(absent, 1.0, before))
    return growth


@inline
def _condition(belief, work, omega, p):
    """The filter's update at the true rate, without its safeguards for an estimated rate."""
    J_inv = inverse(estimated_inertia(belief))
    store_symmetric(work.jacobian[0], J_inv)
    write_times_regressor(work.jacobian[0], (-omega[0], -omega[1], -omega[2]), work.regressor)
    for i in range(3):
        work.rows[i, :3], work.rows[i, 3 : 3 + p] = work.jacobian[0, i], work.regressor[i]
        work.rows[i, 3 + p :] = work.innovation[i] = 0.0
    spin = congruence(J_inv, load_symmetric(belief.wheel_momentum_covariance))
    momentum_model.whiten(work, add_diagonal(belief.gyro_std**2, spin))
    update(belief, work, 3)


@kernel
def bound_many(beliefs, work, series, dt, out):
    """The filter's covariance with the truth in the place of its mean, for every episode."""
    belief, theta, p = beliefs[0], series.theta, series.theta.shape[2]
    for i in range(theta.shape[0]):
        belief.prior_theta[:] = theta[i, 0]
        momentum_start.start(belief, work[0], series.rate[i, 0], series.wheel_speed[i, 0])
        out[i, 0] = belief.covariance[3 : 3 + p, 3 : 3 + p]
        for k in range(1, theta.shape[1]):
            belief.mean[:3], belief.mean[3 + p :] = series.momentum[i, k - 1], series.torque[i, k - 1]
            belief.mean[3 : 3 + p] = theta[i, k - 1]
            momentum_filter.predict(belief, work[0], series.wheel_speed[i, k], dt)
            for j in range(p):
                belief.covariance[3 + j] *= series.growth[i, k, j]
                belief.covariance[:, 3 + j] *= series.growth[i, k, j]
            belief.mean[:3], belief.mean[3 : 3 + p] = series.momentum[i, k], theta[i, k]
            _condition(belief, work[0], load(series.rate[i, k]), p)
            out[i, k] = belief.covariance[3 : 3 + p, 3 : 3 + p]


def population_bound(covariance: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Least mean square (T,) over the episodes of the relative error of the inertia (the paper's norm ratio).

    Args:
        covariance: (N, T, p, p) bounds on theta's covariance, or (N, T, p) on its variances.
        inertia: (N, T, 3, 3) truth.
    """
    relative = _relative(covariance, inertia)
    return np.linalg.inv(np.linalg.inv(relative).mean(axis=0)).trace(axis1=1, axis2=2)


def episode_bounds(covariance: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Least mean square (N, T) of the relative error of the inertia, episode by episode."""
    return _relative(covariance, inertia).trace(axis1=2, axis2=3)


def _relative(covariance: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Covariance (N, T, p, p) of the entries of J over its norm."""
    p = covariance.shape[2]
    if covariance.ndim == 3:
        covariance = covariance[..., None] * np.eye(p)
    size = np.linalg.norm(inertia, axis=(2, 3))[..., None, None]
    weight = np.sqrt(np.repeat([1.0, 2.0], (3, p - 3)))  # a product of inertia stands twice in the tensor
    return covariance * (weight[:, None] * weight) / size**2
