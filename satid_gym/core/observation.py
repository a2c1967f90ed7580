"""Observation: belief and measurement, normalised so that one policy can fly any satellite."""

from __future__ import annotations

import numpy as np

from satid_gym.core import momentum_filter
from satid_gym.core.algebra import add, cross, inverse, load, multiply
from satid_gym.core.jit import inline
from satid_gym.core.kalman import estimated_inertia
from satid_gym.core.records import MOMENTUM

BOUND = 10.0


def layout(n: int, p: int) -> dict[str, slice]:
    """Names and places of the observation's parts for n wheels and p inertia parameters, in order."""
    sizes = {
        "rate": 3,
        "wheel_speed": n,
        "inertia": p,
        "uncertainty": p,
        "disturbance": 3,
        "correlation": 3 * p,
        "authority": 3,
        "swing": 3,
        "drift": 3,
        "command": n,
        "time_left": 1,
    }
    edges = np.cumsum([0, *sizes.values()]).tolist()
    return {name: slice(edges[i], edges[i + 1]) for i, name in enumerate(sizes)}


@inline
def _write(out, i, value):
    out[i] = min(max(value, -BOUND), BOUND)
    return i + 1


@inline
def rate_to_go_by(belief, gyro):
    """The gyro's reading or, where the filter coasts, the filter's own rate."""
    return load(gyro) if belief.coasting == 0 else filter_rate(belief)


@inline
def filter_rate(belief):
    """Estimated omega, rad/s."""
    return momentum_filter.rate(belief) if belief.kind == MOMENTUM else load(belief.mean)


@inline
def observe(belief, task, gyro, tachometer, out):
    """Write the observation, in the order of `layout`."""
    p, n = belief.prior_theta.shape[0], tachometer.shape[0]
    mean, covariance = belief.mean, belief.covariance
    inertia = estimated_inertia(belief)
    omega = filter_rate(belief)
    if belief.kind == MOMENTUM:
        momentum, torque = load(mean), load(mean[3 + p :])
    else:
        spin = momentum_filter.wheel_momentum(belief, mean[3 + p :])
        momentum, torque = add(multiply(inertia, omega), spin), (0.0, 0.0, 0.0)
    drift = multiply(inverse(inertia), add(cross(momentum, omega), torque))
    decision_period = task.sample_period * task.samples
    reading = rate_to_go_by(belief, gyro)
    i = 0
    for k in range(3):
        i = _write(out, i, reading[k] / task.rate_limit)
    for k in range(n):
        speed = tachometer[k] if belief.stuck[k] == 0 else belief.speed[k]
        i = _write(out, i, speed / task.wheel_speed_max[k])
    for k in range(p):
        i = _write(out, i, (mean[3 + k] - belief.prior_theta[k]) / belief.theta_scale[k])
    for k in range(p):
        i = _write(out, i, np.log10(np.sqrt(covariance[3 + k, 3 + k]) / belief.theta_scale[k]) + 2.0)
    for k in range(3):
        i = _write(out, i, torque[k] / belief.prior_torque_std if belief.prior_torque_std > 0.0 else 0.0)
    for r in range(3):
        for k in range(p):
            scale = np.sqrt(covariance[r, r] * covariance[3 + k, 3 + k])
            i = _write(out, i, covariance[r, 3 + k] / scale)
    for k in range(3):
        i = _write(out, i, task.authority[k])
    for k in range(3):
        i = _write(out, i, task.swing[k])
    for k in range(3):
        i = _write(out, i, drift[k] * decision_period / task.rate_limit)
    for k in range(n):
        i = _write(out, i, task.command[k])
    _write(out, i, 1.0 - task.decision / task.decisions)
