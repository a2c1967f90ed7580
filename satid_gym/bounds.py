"""How well the inertia can be known: the least mean square error of any estimator, and of any excitation.

Posterior bound: Tichavsky's recursion for the MomentumEKF's model along true trajectories,

    I' = (Q + F I^-1 F^T)^-1 + H^T R^-1 H,

F, H, Q and R at the true state: the filter's own Riccati equation with the truth in the place of the estimate.
Two averages over episodes: `population_bound` takes the mean of theta's information, which is never below
Tichavsky's bound for the population; the mean of `episode_bounds` is by Jensen's inequality not below that, and
is what an efficient filter reaches, for it knows from its readings how much each episode tells.

Envelope bound: what no excitation can beat that keeps to the rate, torque and wheel speed limits. Given M, the
disturbance and all other parameters exactly, one sample tells about parameter j of theta

    L_j(omega)^T (sigma^2 J^2 + N)^-1 L_j(omega),      J omega = L(omega) theta,

with N the covariance of the measured wheel momentum: at most its value with every |omega_i| at the largest
that the limits allow,

    |omega_i| <= rate limit,
    |omega_i| <= sum_j |J^-1|_ij (|M| + (|A| j Omega_max)_j),                 what the wheels can store
    |omega_i| <= sum_j |G|_ij (|p0|_j + t ((|A| u_max)_j + |M| |omega| + |tau|)),   what torque reached so far

where G = (J - A j A^T)^-1, p0 = (M - A h) at the start and |M| <= |M(0)| + t |tau|. Knowing more never makes a
posterior variance larger, so the scalar Riccati equation of each parameter, with the walk of theta, bounds
its variance from below. Assumptions: sensor noise as the filter has it, white; nothing is learned from commanded
torque; the body stays inside the rate limit.
Source: Tichavsky, Muravchik and Nehorai, IEEE Trans. Signal Processing 46 (1998); the rest is derived here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.core import momentum_filter
from satid_gym.core.algebra import add_diagonal, congruence, inverse, load, load_symmetric, store_symmetric
from satid_gym.core.jit import inline, kernel
from satid_gym.core.kalman import estimated_inertia, update, write_times_regressor
from satid_gym.core.vetting import STEP
from satid_gym.estimators.belief import new_belief, new_work
from satid_gym.estimators.settings import (
    PRODUCTS,
    Briefing,
    MomentumEKFSettings,
    estimated_parameters,
    inertia_parameters,
)
from satid_gym.satellite import Satellite

_SUDDEN = 0.02  # change of a parameter from one instant to the next, over its scale, that is a step


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """True trajectories of N episodes at T instants, evenly spaced; body frame, SI units.

    Attributes:
        momentum: (N, T, 3) M, N m s.
        rate: (N, T, 3) omega, rad/s.
        wheel_speed: (N, T, n) Omega, rad/s.
        inertia: (N, T, 3, 3) J, kg m^2.
        torque: (N, T, 3) external torque, N m.
    """

    momentum: np.ndarray
    rate: np.ndarray
    wheel_speed: np.ndarray
    inertia: np.ndarray
    torque: np.ndarray


def posterior_bound(
    course: Course, briefing: Briefing, settings: MomentumEKFSettings, dt: float, *, law_known: bool = False
) -> np.ndarray:
    """Bound on theta's covariance (N, T, p, p) of each episode, kg^2 m^4.

    Args:
        course: the truth.
        briefing: sensors and prior.
        settings: the model: principal or full parameters, and the walks.
        dt: s between two instants.
        law_known: the filter knows by what factor each parameter changes from instant to instant, and only
            its size is unknown; with `inertia_walk` 0, what a filter that knew the law could reach.

    Raises:
        ValueError: the law is to be known and takes a product of inertia through zero.
    """
    parameters = estimated_parameters(settings.parameters, briefing)
    theta = inertia_parameters(course.inertia, parameters)
    growth = _growth(theta, law_known)
    belief = new_belief(briefing, settings)
    work = new_work(belief)
    p = theta.shape[2]
    out = np.empty((*theta.shape, p))
    series = (course.momentum, course.rate, course.wheel_speed, course.torque)
    bound_many(belief, work, *map(np.ascontiguousarray, series), np.ascontiguousarray(theta), growth, dt, out)
    return out


def _growth(theta: np.ndarray, law_known: bool) -> np.ndarray:
    """Factors (N, T, p) from the instant before; 1 where the law is not known."""
    return law_growth(theta) if law_known else np.ones_like(theta)


def law_growth(theta: np.ndarray) -> np.ndarray:
    """By what factors (N, T, p) parameters theta (N, T, p) grow from the instant before.

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
    """The filter's update at the true rate, without what it does because it has only an estimate of it."""
    flexibility = inverse(estimated_inertia(belief))
    store_symmetric(work.jacobian[0], flexibility)
    write_times_regressor(work.jacobian[0], (-omega[0], -omega[1], -omega[2]), work.regressor)
    for i in range(3):
        work.rows[i, :3], work.rows[i, 3 : 3 + p] = work.jacobian[0, i], work.regressor[i]
        work.innovation[i] = 0.0
    spin = congruence(flexibility, load_symmetric(belief.wheel_momentum_covariance))
    momentum_filter._whiten(work, add_diagonal(belief.gyro_std**2, spin), 3 + p)
    update(belief, work, 3, 3 + p)


def _build_bound_many(fingerprint):
    def bound_many(beliefs, work, momentum, rate, wheel_speed, torque, theta, growth, dt, out):
        """The filter's covariance with the truth in the place of its mean, for every episode."""
        fingerprint  # noqa: B018
        belief, p = beliefs[0], theta.shape[2]
        for i in range(theta.shape[0]):
            belief.prior_theta[:] = theta[i, 0]
            momentum_filter.start(belief, work[0], rate[i, 0], wheel_speed[i, 0])
            out[i, 0] = belief.covariance[3 : 3 + p, 3 : 3 + p]
            for k in range(1, theta.shape[1]):
                belief.mean[:3], belief.mean[3 + p :] = momentum[i, k - 1], torque[i, k - 1]
                belief.mean[3 : 3 + p] = theta[i, k - 1]
                momentum_filter.predict(belief, work[0], wheel_speed[i, k], dt)
                for j in range(p):
                    belief.covariance[3 + j] *= growth[i, k, j]
                    belief.covariance[:, 3 + j] *= growth[i, k, j]
                belief.mean[:3], belief.mean[3 : 3 + p] = momentum[i, k], theta[i, k]
                _condition(belief, work[0], load(rate[i, k]), p)
                out[i, k] = belief.covariance[3 : 3 + p, 3 : 3 + p]

    return bound_many


bound_many = kernel(_build_bound_many)


def envelope_bound(
    course: Course,
    satellite: Satellite,
    briefing: Briefing,
    settings: MomentumEKFSettings,
    dt: float,
    *,
    law_known: bool = False,
) -> np.ndarray:
    """Variance (N, T, p), kg^2 m^4, that no excitation inside the envelope can beat.

    Args:
        course: of it only the start, the true inertia and the size of the external torque are used.
        satellite: with the limits that it is operated with.
        briefing, settings, dt, law_known: see `posterior_bound`.
    """
    parameters = estimated_parameters(settings.parameters, briefing)
    theta = inertia_parameters(course.inertia, parameters)
    growth = _growth(theta, law_known)
    information = sample_information(rate_cap(course, satellite, dt), course.inertia, briefing, theta.shape[2])
    scale = briefing.theta_scale(parameters)
    walk = (settings.inertia_walk * scale) ** 2 * dt
    variance = np.broadcast_to(briefing.prior_theta_std(parameters) ** 2, theta[:, 0].shape)
    out = np.empty_like(theta)
    for k in range(theta.shape[1]):
        if k > 0:
            variance = growth[:, k] ** 2 * (variance + walk)
        variance = variance / (1.0 + variance * information[:, k])
        out[:, k] = variance
    return out


def rate_cap(course: Course, satellite: Satellite, dt: float) -> np.ndarray:
    """Largest |omega_i| (N, T, 3) that the rate, wheel speed and torque limits allow, rad/s."""
    wheels = satellite.wheels
    time = dt * np.arange(course.momentum.shape[1])[None, :, None]
    torque = np.linalg.norm(course.torque, axis=2).max(axis=1)[:, None, None]
    momentum = np.linalg.norm(course.momentum[:, 0], axis=1)[:, None, None] + time * torque
    stored = momentum + np.abs(wheels.axes) @ (wheels.inertia * wheels.max_speed)
    by_storage = _times(np.abs(np.linalg.inv(course.inertia)), stored)
    loose = course.inertia - wheels.carried_inertia
    start = np.abs(_times(loose[:, 0], course.rate[:, 0]))[:, None]
    push = np.abs(wheels.axes) @ wheels.max_torque + momentum * np.sqrt(3.0) * satellite.rate_limit + torque
    by_torque = _times(np.abs(np.linalg.inv(loose)), start + time * push)
    return np.minimum(satellite.rate_limit, np.minimum(by_storage, by_torque))


def sample_information(cap: np.ndarray, inertia: np.ndarray, briefing: Briefing, parameters: int) -> np.ndarray:
    """Most that a sample tells about each parameter alone, (..., p), for |omega| at most `cap` (..., 3)."""
    wheels = briefing.wheels
    noise = (wheels.axes * (wheels.inertia * briefing.tachometer_noise_std) ** 2) @ wheels.axes.T
    weight = np.linalg.inv(briefing.gyro_noise_std**2 * inertia @ inertia + noise)
    parts = [weight[..., i, i] * cap[..., i] ** 2 for i in range(3)]
    for i, j in PRODUCTS[: parameters - 3]:
        own = weight[..., i, i] * cap[..., j] ** 2 + weight[..., j, j] * cap[..., i] ** 2
        parts.append(own + 2.0 * np.abs(weight[..., i, j]) * cap[..., i] * cap[..., j])
    return np.stack(parts, axis=-1)


def population_bound(covariance: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Least mean square (T,) over the episodes of the relative error of the inertia (the paper's norm ratio).

    Args:
        covariance: (N, T, p, p) bounds on theta's covariance, or (N, T, p) on its variances.
        inertia: (N, T, 3, 3) truth.
    """
    relative = _relative(covariance, inertia)
    return np.linalg.inv(np.linalg.inv(relative).mean(axis=0)).trace(axis1=1, axis2=2)


def episode_bounds(covariance: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """The same (N, T) for each episode by itself."""
    return _relative(covariance, inertia).trace(axis1=2, axis2=3)


def _relative(covariance: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Covariance (N, T, p, p) of the entries of J over its norm."""
    p = covariance.shape[2]
    if covariance.ndim == 3:
        covariance = covariance[..., None] * np.eye(p)
    size = np.linalg.norm(inertia, axis=(2, 3))[..., None, None]
    weight = np.sqrt(np.repeat([1.0, 2.0], (3, p - 3)))  # a product of inertia stands twice in the tensor
    return covariance * (weight[:, None] * weight) / size**2


def ideal_error(
    course: Course,
    satellite: Satellite,
    briefing: Briefing,
    settings: MomentumEKFSettings,
    dt: float,
    *,
    finds_steps: bool = False,
) -> np.ndarray:
    """Mean square error (N, T, p) of a given filter if every sample told as much as the envelope allows.

    Not a bound: what its tuning leaves of the envelope bound for the true course of the inertia. The filter's
    gain is that of its own Riccati equation; the error is the noise it lets through and its lag, squared.

    Args:
        course: truth, of N episodes at T instants.
        satellite: with the limits it is operated with.
        briefing: what the filter knows.
        settings: of the filter.
        dt: s between two instants.
        finds_steps: whether the filter is told when the inertia steps, as the AdaptiveEKF would find it.
    """
    parameters = estimated_parameters(settings.parameters, briefing)
    theta = inertia_parameters(course.inertia, parameters)
    information = sample_information(rate_cap(course, satellite, dt), course.inertia, briefing, theta.shape[2])
    believed = np.broadcast_to(briefing.prior_theta_std(parameters) ** 2, theta[:, 0].shape)
    scale = briefing.theta_scale(parameters)
    walk = (settings.inertia_walk * scale) ** 2 * dt
    lag = inertia_parameters(briefing.inertia, parameters) - theta[:, 0]
    noise = np.zeros_like(lag)
    out = np.empty_like(theta)
    for k in range(theta.shape[1]):
        if k > 0:
            change = theta[:, k] - theta[:, k - 1]
            believed, lag = believed + walk, lag - change
            if finds_steps:
                stepped = (np.abs(change) > _SUDDEN * scale).any(axis=1, keepdims=True)
                believed = believed + np.where(stepped, (STEP * scale) ** 2, 0.0)
        told = believed * information[:, k]
        believed, lag = believed / (1.0 + told), lag / (1.0 + told)
        noise = (noise / (1.0 + told) + believed * told) / (1.0 + told)
        out[:, k] = noise + lag**2
    return out


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return (matrices @ vectors[..., None])[..., 0]
