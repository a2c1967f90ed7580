"""Envelope bound: what no excitation can beat that keeps to the rate, torque and wheel speed limits. Given M, the
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

Derived here.
"""

from __future__ import annotations

import numpy as np

from satid_gym.bounds.motion import TrueMotion
from satid_gym.bounds.posterior import growth_factors
from satid_gym.core.belief.gating import STEP
from satid_gym.estimators.inertia import PRODUCTS, inertia_parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior, estimated_parameters
from satid_gym.satellite import Satellite

_SUDDEN = 0.02  # change of a parameter from one instant to the next, over its scale, that is a step


def envelope_bound(
    motion: TrueMotion,
    satellite: Satellite,
    prior: FilterPrior,
    settings: MomentumEKFSettings,
    dt: float,
    *,
    law_known: bool = False,
) -> np.ndarray:
    """Variance (N, T, p), kg^2 m^4, that no excitation inside the envelope can beat.

    Args:
        motion: of it only the start, the true inertia and the size of the external torque are used.
        satellite: with the limits that it is operated with.
        prior, settings, dt, law_known: see `posterior_bound`.
    """
    parameters = estimated_parameters(settings.parameters, prior)
    theta = inertia_parameters(motion.inertia, parameters)
    growth = growth_factors(theta, law_known)
    information = sample_information(rate_cap(motion, satellite, dt), motion.inertia, prior, theta.shape[2])
    scale = prior.theta_scale(parameters)
    walk = (settings.inertia_walk * scale) ** 2 * dt
    variance = np.broadcast_to(prior.prior_theta_std(parameters) ** 2, theta[:, 0].shape)
    out = np.empty_like(theta)
    for k in range(theta.shape[1]):
        if k > 0:
            variance = growth[:, k] ** 2 * (variance + walk)
        variance = variance / (1.0 + variance * information[:, k])
        out[:, k] = variance
    return out


def rate_cap(motion: TrueMotion, satellite: Satellite, dt: float) -> np.ndarray:
    """Largest |omega_i| (N, T, 3) that the rate, wheel speed and torque limits allow, rad/s."""
    wheels = satellite.wheels
    time = dt * np.arange(motion.momentum.shape[1])[None, :, None]
    torque = np.linalg.norm(motion.torque, axis=2).max(axis=1)[:, None, None]
    momentum = np.linalg.norm(motion.momentum[:, 0], axis=1)[:, None, None] + time * torque
    stored = momentum + wheels.momentum_reach
    by_storage = _times(np.abs(np.linalg.inv(motion.inertia)), stored)
    J_free = motion.inertia - wheels.rotor_inertia
    start = np.abs(_times(J_free[:, 0], motion.rate[:, 0]))[:, None]
    push = wheels.torque_reach + momentum * np.sqrt(3.0) * satellite.rate_limit + torque
    by_torque = _times(np.abs(np.linalg.inv(J_free)), start + time * push)
    return np.minimum(satellite.rate_limit, np.minimum(by_storage, by_torque))


def sample_information(cap: np.ndarray, inertia: np.ndarray, prior: FilterPrior, parameters: int) -> np.ndarray:
    """Largest information of a sample on each parameter alone, (..., p), for |omega| at most `cap` (..., 3)."""
    wheels = prior.wheels
    noise = (wheels.axes * (wheels.inertia * prior.tachometer_noise_std) ** 2) @ wheels.axes.T
    weight = np.linalg.inv(prior.gyro_noise_std**2 * inertia @ inertia + noise)
    parts = [weight[..., i, i] * cap[..., i] ** 2 for i in range(3)]
    for i, j in PRODUCTS[: parameters - 3]:
        own = weight[..., i, i] * cap[..., j] ** 2 + weight[..., j, j] * cap[..., i] ** 2
        parts.append(own + 2.0 * np.abs(weight[..., i, j]) * cap[..., i] * cap[..., j])
    return np.stack(parts, axis=-1)


def reference_limit(
    motion: TrueMotion,
    satellite: Satellite,
    prior: FilterPrior,
    settings: MomentumEKFSettings,
    dt: float,
    *,
    finds_steps: bool = False,
    information: np.ndarray | None = None,
) -> np.ndarray:
    """Mean square error (N, T, p) of a given filter if every sample were as informative as the envelope allows.

    Not a bound: what its tuning leaves of the envelope bound for the true variation of the inertia. The filter's
    gain is that of its own Riccati equation; the error is the noise it lets through and its lag, squared.

    Args:
        motion: truth, of N episodes at T instants.
        satellite: with the limits it is operated with.
        prior: what the filter knows.
        settings: of the filter.
        dt: s between two instants.
        finds_steps: whether the filter is told when the inertia steps, as the AdaptiveEKF would find it.
        information: (N, T, p) of `sample_information`, to compute it once for several filters.
    """
    parameters = estimated_parameters(settings.parameters, prior)
    theta = inertia_parameters(motion.inertia, parameters)
    if information is None:
        information = sample_information(rate_cap(motion, satellite, dt), motion.inertia, prior, theta.shape[2])
    believed = np.broadcast_to(prior.prior_theta_std(parameters) ** 2, theta[:, 0].shape)
    scale = prior.theta_scale(parameters)
    walk = (settings.inertia_walk * scale) ** 2 * dt
    lag = inertia_parameters(prior.inertia, parameters) - theta[:, 0]
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
