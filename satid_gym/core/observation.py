"""Observation: belief and measurement, normalised so that one policy can fly any satellite.

In the form "wheels" speeds and previous action are observed wheel by wheel. In the form "body" what the wheels do to
the body takes their place, so that a policy does not depend on how many there are, and NIS and modes are observed too.
Where there is a star tracker, both forms have what is known of the attitude, and where Sun and Earth are that blind it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from satid_gym.core.algebra import add, cross, inverse, load_symmetric, multiply, scale_symmetric
from satid_gym.core.belief import filters, modes, whiteness
from satid_gym.core.belief.kalman import estimated_inertia, theta_covariance
from satid_gym.core.jit import inline, outline
from satid_gym.core.observed_number import BOUND, LOG_OFFSET, log_share, write
from satid_gym.core.observed_sky import attitude_std, observe_sky, observe_window
from satid_gym.core.records import ObservationForm
from satid_gym.core.wheels import reachable, speed_shares, sum_wheels, wheel_momentum

Form = Literal["wheels", "body"]
MODE_PARTS = {
    "deflection": 1,
    "deflection_rate": 1,
    "deflection_limit": 1,
    "frequency": 1,
    "frequency_std": 1,
    "coupling": 3,
    "coupling_std": 1,
    "damping": 1,
    "damping_std": 1,
    "centrifugal": 6,
}
"""Sizes of what is observed of a mode, in order."""
MODE_PLACES = dict(zip(MODE_PARTS, np.cumsum([0, *MODE_PARTS.values()]).tolist(), strict=False))
"""Where each of these begins."""
_BODY = int(ObservationForm.BODY)


def layout(
    n: int,
    p: int,
    others: int = 0,
    form: Form = "wheels",
    mode_count: int = 0,
    actions: int | None = None,
    tells_attitude: bool = False,
    tells_walk: bool = False,
    tells_sky: tuple[bool, bool] = (False, False),
    tells_window: bool = False,
    tells_null: bool = False,
) -> dict[str, slice]:
    """Names and places of the observation's parts for n wheels and p inertia parameters, in order.

    `others` is the number of the filter's states apart from the parameters where the whole covariance is observed,
    `mode_count` that of the modes it estimates, which the form "body" alone observes; `actions` that of an action's
    numbers, n where None; `tells_attitude` whether the filter estimates the attitude, `tells_walk` whether the random
    walk of the inertia that it uses is observed, `tells_sky` whether it is observed where Sun and Earth are,
    `tells_window` whether imaging windows and their targets are, `tells_null` whether the form "body" has the
    wheels' momentum in the null space of their axes.
    """
    body = form == "body"
    sizes = {
        "rate": 3,
        **({"wheel_momentum": 3, "fastest_wheel": 2} if body else {"wheel_speed": n}),
        "inertia": p,
        "uncertainty": p,
        "disturbance": 3,
        "correlation": 3 * p,
        "control_authority": 3,
        "momentum_fraction": 3,
        "coast_rate_change": 3,
        "command": 3 if body or actions == 3 else n,
        "time_left": 1,
    }
    if body:
        sizes["nis"], sizes["modes"] = 1, mode_count * sum(MODE_PARTS.values())
    if body and tells_null:
        sizes["null_momentum"] = 1
    if tells_attitude:
        sizes["attitude_uncertainty"], sizes["attitude_age"] = 3, 1
    for name, tells in zip(("sun", "earth"), tells_sky, strict=True):
        if tells:
            sizes[name] = 3
    if tells_window:
        sizes["window"], sizes["target"] = 2, 3
    if tells_walk:
        sizes["inertia_walk"] = 1
    if others > 0:
        states = others + p
        sizes["state_uncertainty"] = others
        sizes["state_correlation"] = states * (states - 1) // 2 - 3 * p
    edges = np.cumsum([0, *sizes.values()]).tolist()
    return {name: slice(edges[i], edges[i + 1]) for i, name in enumerate(sizes)}


def state_pairs(p: int, others: int) -> list[tuple[int, int]]:
    """States of each number of the part `state_correlation`, in order; 3 to 2 + p are the inertia parameters."""
    states = [(r, c) for r in range(p + others) for c in range(r + 1, p + others)]
    return [(r, c) for r, c in states if r >= 3 or c < 3 or c >= 3 + p]


def observed_std(value: np.ndarray) -> np.ndarray:
    """Standard deviations, over their scale, that observed `uncertainty` stands for."""
    return 10.0 ** (value - LOG_OFFSET)


@outline
def observe(belief, task, gyro, tachometer, out):
    """Write the observation, in the order of `layout`."""
    p = belief.prior_theta.shape[0]
    mean, covariance = belief.mean, belief.covariance
    inertia = estimated_inertia(belief)
    omega = filters.rate(belief)
    momentum, torque = filters.momentum_and_torque(belief)
    coast_rate_change = multiply(inverse(inertia), add(cross(momentum, omega), torque))
    decision_period = task.sample_period * task.samples
    reading = filters.rate_used(belief, gyro)
    i = 0
    for k in range(3):
        i = write(out, i, reading[k] / task.rate_limit)
    if task.observation == _BODY:
        i = _observe_wheels_on_body(belief, task, reading, tachometer, out, i)
    else:
        for k in range(tachometer.shape[0]):
            i = write(out, i, filters.wheel_speed_used(belief, tachometer, k) / task.wheel_speed_max[k])
    for k in range(p):
        i = write(out, i, (mean[3 + k] - belief.prior_theta[k]) / belief.theta_scale[k])
    for k in range(p):
        i = write(out, i, np.log10(np.sqrt(theta_covariance(belief, k, k)) / belief.theta_scale[k]) + LOG_OFFSET)
    for k in range(3):
        i = write(out, i, torque[k] / belief.prior_torque_std if belief.prior_torque_std > 0.0 else 0.0)
    for r in range(3):
        for k in range(p):
            scale = np.sqrt(covariance[r, r] * theta_covariance(belief, k, k))
            i = write(out, i, covariance[r, 3 + k] / scale)
    for k in range(3):
        i = write(out, i, task.control_authority[k])
    for k in range(3):
        i = write(out, i, task.momentum_fraction[k])
    for k in range(3):
        i = write(out, i, coast_rate_change[k] * decision_period / task.rate_limit)
    i = _observe_command(belief, task, out, i)
    i = write(out, i, 1.0 - task.decision / task.decisions)
    if task.observation == _BODY:
        i = write(out, i, np.log10(task.nis_sum / task.nis_count) if task.nis_count > 0 else 0.0)
        i = _observe_modes(belief, task, omega, out, i)
        if task.tracking.null.on != 0:
            i = write(out, i, _null_momentum(belief, task.tracking.null, tachometer))
    if belief.attitude.boresight.shape[0] > 0:
        i = write(out, i, log_share(attitude_std(belief, 1.0, 0.0, 0.0)))
        i = write(out, i, log_share(attitude_std(belief, 0.0, 1.0, 0.0)))
        i = write(out, i, log_share(attitude_std(belief, 0.0, 0.0, 1.0)))
        i = write(out, i, belief.attitude.age / decision_period)
        i = observe_sky(belief, task, out, i)
        if task.tells_window != 0:
            i = observe_window(belief, task, out, i)
    if task.tells_walk != 0:
        i = write(out, i, log_share(whiteness.inertia_walk(belief)))
    if i < out.shape[0]:
        _observe_covariance(belief, task, out, i)


@inline
def _observe_command(belief, task, out, i):
    """Write the previous action, a torque in the form BODY as that on the body over the most along each axis."""
    if task.observation != _BODY or task.tracking.on != 0:
        for k in range(3 if task.tracking.on != 0 else task.command.shape[0]):
            i = write(out, i, task.command[k])
        return i
    torque = sum_wheels(belief.axes, task.command * task.torque_max)
    most = reachable(belief.axes, task.torque_max)
    for k in range(3):
        i = write(out, i, -torque[k] / most[k])  # the body feels the opposite
    return i


@outline
def _observe_wheels_on_body(belief, task, omega, tachometer, out, i):
    """Write the wheels' momentum over the most along each axis, and how near the fastest is to its limit."""
    speed = np.empty(tachometer.shape[0])
    for k in range(speed.shape[0]):
        speed[k] = filters.wheel_speed_used(belief, tachometer, k)
    stored = wheel_momentum(belief, speed)
    most = reachable(belief.axes, belief.wheel_inertia * task.wheel_speed_max)
    for k in range(3):
        i = write(out, i, stored[k] / most[k])
    rates = omega, task.rate_limit
    now, worst = speed_shares(belief, speed, task.wheel_speed_max, estimated_inertia(belief), rates)
    i = write(out, i, now)
    return write(out, i, worst)


@inline
def _null_momentum(belief, null, tachometer):
    """z by the wheels' speeds, over the most (`core.control.null_motion`)."""
    along = square = 0.0
    for k in range(tachometer.shape[0]):
        momentum = belief.wheel_inertia[k] * filters.wheel_speed_used(belief, tachometer, k)
        along += null.direction[k] * momentum
        square += null.direction[k] ** 2
    return along / (square * null.most)


@outline
def _observe_modes(belief, task, omega, out, i):
    """Write what is estimated of each mode, in the order of `MODE_PARTS`.

    Deflection and its rate are over those that a step of the body rate by its limit rings, see `modes.rung_rate`.
    """
    own, mean, covariance = belief.modes, belief.mean, belief.covariance
    inertia, period = estimated_inertia(belief), task.sample_period * task.samples
    for m in range(own.coupling.shape[0]):
        at = own.first + modes.STATES * m
        rung = modes.rung_rate(belief, m, task.rate_limit)
        per_rung = 1.0 / rung if rung > 0.0 else 0.0
        i = write(out, i, mean[at] * own.frequency[m] * per_rung)
        i = write(out, i, modes.deflection_rate(belief, m, omega) * per_rung)
        i = write(out, i, modes.limit_of(belief, m) * own.frequency[m] * per_rung)
        i = write(out, i, own.w[m] * period / (2.0 * np.pi))
        i = write(out, i, log_share(np.sqrt(covariance[at + 2, at + 2])))
        for k in range(3):
            i = write(out, i, own.d[m, k] / np.sqrt(inertia[k]))
        i = write(out, i, log_share(np.sqrt(covariance[at + 3, at + 3])))
        i = write(out, i, log_share(own.zeta[m]))
        i = write(out, i, log_share(np.sqrt(covariance[at + 4, at + 4])))
        pull = 0.5 * task.rate_limit**2 / own.w[m] ** 2 * own.frequency[m] * per_rung
        K = scale_symmetric(pull, load_symmetric(own.D[m]))
        for k in range(6):
            i = write(out, i, K[k])
    return i


@inline
def _observe_covariance(belief, task, out, i):
    """Write what the parts before leave out of the covariance."""
    p, covariance = belief.prior_theta.shape[0], belief.covariance
    states = covariance.shape[0]
    for r in range(states):
        if r < 3 or r >= 3 + p:
            std, scale = np.sqrt(covariance[r, r]), filters.state_scale(belief, task, r)
            i = write(out, i, np.log10(std / scale) + LOG_OFFSET if scale > 0.0 else -BOUND)
    for r in range(states):
        for c in range(r + 1, states):
            if r >= 3 or c < 3 or c >= 3 + p:
                scale = np.sqrt(covariance[r, r] * covariance[c, c])
                i = write(out, i, covariance[r, c] / scale if scale > 0.0 else 0.0)
