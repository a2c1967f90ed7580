"""Observation: belief and measurement, normalised so that one policy can fly any satellite."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import add, cross, inverse, multiply
from satid_gym.core.belief import filters
from satid_gym.core.belief.kalman import estimated_inertia, theta_covariance
from satid_gym.core.jit import inline, outline

BOUND = 10.0


def layout(n: int, p: int, others: int = 0, actions: int | None = None) -> dict[str, slice]:
    """Names and places of the observation's parts for n wheels and p inertia parameters, in order.

    `actions` is the number of an action's numbers, n where None.
    `others` is the number of the filter's states beside the parameters where the whole covariance is observed.
    """
    sizes = {
        "rate": 3,
        "wheel_speed": n,
        "inertia": p,
        "uncertainty": p,
        "disturbance": 3,
        "correlation": 3 * p,
        "control_authority": 3,
        "momentum_fraction": 3,
        "coast_rate_change": 3,
        "command": n if actions is None else actions,
        "time_left": 1,
    }
    if others > 0:
        states = others + p
        sizes["state_uncertainty"] = others
        sizes["state_correlation"] = states * (states - 1) // 2 - 3 * p
    edges = np.cumsum([0, *sizes.values()]).tolist()
    return {name: slice(edges[i], edges[i + 1]) for i, name in enumerate(sizes)}


_LOG_OFFSET = 2.0  # a standard deviation of 1 % of its scale is observed as 0


def observed_std(value: np.ndarray) -> np.ndarray:
    """Standard deviations, over their scale, that observed `uncertainty` stands for."""
    return 10.0 ** (value - _LOG_OFFSET)


@inline
def _write(out, i, value):
    out[i] = min(max(value, -BOUND), BOUND)
    return i + 1


@outline
def observe(belief, task, gyro, tachometer, out):
    """Write the observation, in the order of `layout`."""
    p, n = belief.prior_theta.shape[0], tachometer.shape[0]
    mean, covariance = belief.mean, belief.covariance
    inertia = estimated_inertia(belief)
    omega = filters.rate(belief)
    momentum, torque = filters.momentum_and_torque(belief)
    coast_rate_change = multiply(inverse(inertia), add(cross(momentum, omega), torque))
    decision_period = task.sample_period * task.samples
    reading = filters.rate_used(belief, gyro)
    i = 0
    for k in range(3):
        i = _write(out, i, reading[k] / task.rate_limit)
    for k in range(n):
        speed = tachometer[k] if belief.stuck[k] == 0 else belief.speed[k]
        i = _write(out, i, speed / task.wheel_speed_max[k])
    for k in range(p):
        i = _write(out, i, (mean[3 + k] - belief.prior_theta[k]) / belief.theta_scale[k])
    for k in range(p):
        i = _write(out, i, np.log10(np.sqrt(theta_covariance(belief, k, k)) / belief.theta_scale[k]) + _LOG_OFFSET)
    for k in range(3):
        i = _write(out, i, torque[k] / belief.prior_torque_std if belief.prior_torque_std > 0.0 else 0.0)
    for r in range(3):
        for k in range(p):
            scale = np.sqrt(covariance[r, r] * theta_covariance(belief, k, k))
            i = _write(out, i, covariance[r, 3 + k] / scale)
    for k in range(3):
        i = _write(out, i, task.control_authority[k])
    for k in range(3):
        i = _write(out, i, task.momentum_fraction[k])
    for k in range(3):
        i = _write(out, i, coast_rate_change[k] * decision_period / task.rate_limit)
    for k in range(task.command.shape[0]):
        i = _write(out, i, task.command[k])
    i = _write(out, i, 1.0 - task.decision / task.decisions)
    if i < out.shape[0]:
        _observe_covariance(belief, task, out, i)


@inline
def _observe_covariance(belief, task, out, i):
    """Write what the parts before leave out of the covariance."""
    p, covariance = belief.prior_theta.shape[0], belief.covariance
    states = covariance.shape[0]
    for r in range(states):
        if r < 3 or r >= 3 + p:
            std, scale = np.sqrt(covariance[r, r]), filters.state_scale(belief, task, r)
            i = _write(out, i, np.log10(std / scale) + _LOG_OFFSET if scale > 0.0 else -BOUND)
    for r in range(states):
        for c in range(r + 1, states):
            if r >= 3 or c < 3 or c >= 3 + p:
                scale = np.sqrt(covariance[r, r] * covariance[c, c])
                i = _write(out, i, covariance[r, c] / scale if scale > 0.0 else 0.0)
