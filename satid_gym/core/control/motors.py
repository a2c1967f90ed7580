"""Motors as their wheels have shown them: the gain of each, and the Coulomb friction of its wheel.

For the momentum h = j (Omega + A^T omega) of a wheel under a commanded torque u

    dh/dt = g u - c sgn(Omega)

and (g, c) are its least-squares estimate from the samples so far, of which the older count less: R and b are the
information matrix and vector, in fractions of the torque limit and of one sample's information,

    R = L (R - R_0) + R_0 + phi phi^T,    b = L (b - R_0 (1, 0)) + R_0 (1, 0) + phi dh/dt,    phi = (u, -sgn Omega)

with L = exp(-dt / T) and R_0 of the prior. A command counts once it has been much the same for as long as it may come
late; a wheel whose tachometer is stuck, or that is at its speed limit, shows nothing of it.

A wheel that fails does so at once. With z = (dh/dt - g u + c sgn(Omega)) / std of a sample and w = u / std, the gain
has jumped where, over about the last second,

    |sum w min(max(z, -3), 3)| > 6 (sum w^2)^(1/2)    and    |sum w z| > 0.15 sum w^2

of which three samples alone cannot be the cause; a reading that repeats the last does not count, nor a command that
may leave the wheel stuck at rest. What was known of the gain is then forgotten: R_0 stays for it, about
g + sum w z / sum w^2 in the place of 1. A motor with less than a tenth of its torque is lost, and asked for no more
than what shows whether it comes back.

Sources: Ljung, System Identification (1999), ch. 11.2; for the jump Willsky and Jones 1976, A generalized likelihood
ratio approach to the detection and estimation of jumps in linear systems.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.belief.filters import wheel_speed_used
from satid_gym.core.jit import inline
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.wheels import along_axis

_MEMORY = 30.0  # T, s
_HELD = 0.05  # of the torque limit, by which a command may differ from the one before
_OBSERVER, _OBSERVER_MAX = 0.5, 0.05  # 1/s, and of what one sample leaves unexplained, which is mostly noise
_GAINS = (0.05, 2.0)  # range of the estimate
LOST = 0.1  # gain below which no larger command makes up for a weak motor
_RECENT, _RECENT_MIN = 1.0, 10.0  # memory of the test for a jump: s, but no less than so many samples
_CLIP, _SURE, _JUMP = 3.0, 6.0, 0.15  # of that test: std, std, and of the gain
_FREE = 2.0  # times its friction a command has to be for it: less may leave a wheel at rest, stuck
_AT_LIMIT = 0.999  # of the speed limit: from here on a wheel shows nothing of its command


@functools.cache
def motors_dtype(n: int) -> np.dtype:
    """Estimates of n motors and what the next sample is compared with."""
    return np.dtype(
        [
            ("information", FLOAT, (n, 3)),  # R less its prior: g g, g c, c c
            ("vector", FLOAT, (n, 2)),  # b less its prior
            ("gain", FLOAT, n),  # g
            ("friction", FLOAT, n),  # c, of the torque limit
            ("prior", FLOAT, (n, 2)),  # R_0, which is diagonal
            ("expected", FLOAT, n),  # gain about which R_0 is: 1 until it jumps
            ("noise", FLOAT, n),  # std of a sample's dh/dt, of the torque limit
            ("prompt", FLOAT),  # s, after which a command shows in the readings if its motor is well
            ("score", FLOAT, n),  # sum w min(max(z, -3), 3) of the last samples
            ("surprise", FLOAT, n),  # sum w z
            ("weight", FLOAT, n),  # sum w^2
            ("settled", FLOAT),  # s, after which a command has its effect, however late it comes
            ("missing", FLOAT, n),  # what the model does not explain, low-pass filtered, of the torque limit
            ("commanded", FLOAT, n),  # u of the sample before, of the torque limit
            ("held", FLOAT, n),  # s for which it has been much the same
            ("speed", FLOAT, n),  # of the wheels, rad/s
            ("spin", FLOAT, n),  # h, N m s
            ("begun", INT, n),  # 1: speed and spin are known from the sample before
        ],
        align=True,
    )


@inline
def _estimate(s, k):
    """Write gain and friction of motor k."""
    a, b, c = s.information[k, 0] + s.prior[k, 0], s.information[k, 1], s.information[k, 2] + s.prior[k, 1]
    x, y = s.vector[k, 0] + s.prior[k, 0] * s.expected[k], s.vector[k, 1]
    det = a * c - b * b
    s.gain[k] = min(max((c * x - b * y) / det, _GAINS[0]), _GAINS[1])
    s.friction[k] = min(max((a * y - b * x) / det, 0.0), 1.0)


@inline
def _learn(s, k, moved, keep):
    """Take in dh/dt of motor k, of its torque limit, which the command of the sample before has caused."""
    u, side = s.commanded[k], -np.sign(s.speed[k])
    s.information[k, 0] = keep * s.information[k, 0] + u * u
    s.information[k, 1] = keep * s.information[k, 1] + u * side
    s.information[k, 2] = keep * s.information[k, 2] + side * side
    s.vector[k, 0] = keep * s.vector[k, 0] + u * moved
    s.vector[k, 1] = keep * s.vector[k, 1] + side * moved
    _estimate(s, k)


@inline
def _forget_gain(s, k):
    """Forget what was known of the gain of motor k but for what its last samples say; its friction stays."""
    a, b, c = s.information[k, 0] + s.prior[k, 0], s.information[k, 1], s.information[k, 2]
    s.expected[k] = min(max(s.gain[k] + s.surprise[k] / s.weight[k], 0.0), 1.0)
    s.information[k, 0] = s.information[k, 1] = s.vector[k, 0] = 0.0
    s.information[k, 2] = max(c - b * b / a, 0.0)
    s.vector[k, 1] = (s.information[k, 2] + s.prior[k, 1]) * s.friction[k]
    s.missing[k] = s.score[k] = s.surprise[k] = s.weight[k] = 0.0
    _estimate(s, k)


@inline
def _test_for_jump(s, k, moved, dt):
    """Take in dh/dt of motor k, of its torque limit, for whether its gain has jumped."""
    u, side = s.commanded[k], -np.sign(s.speed[k])
    a, b, c = s.information[k, 0] + s.prior[k, 0], s.information[k, 1], s.information[k, 2] + s.prior[k, 1]
    unknown = (c * u * u - 2.0 * b * u * side + a * side * side) / (a * c - b * b)
    std = s.noise[k] * np.sqrt(1.0 + unknown)
    w, z = u / std, (moved - s.gain[k] * u - s.friction[k] * side) / std
    keep = np.exp(-min(dt / _RECENT, 1.0 / _RECENT_MIN))
    s.score[k] = keep * s.score[k] + w * min(max(z, -_CLIP), _CLIP)
    s.surprise[k] = keep * s.surprise[k] + w * z
    s.weight[k] = keep * s.weight[k] + w * w
    if abs(s.score[k]) > _SURE * np.sqrt(s.weight[k]) and abs(s.surprise[k]) > _JUMP * s.weight[k]:
        _forget_gain(s, k)


@inline
def observe(task, belief, tachometer, omega, dt):
    """Take in the tachometers (n,), rad/s, at body rate omega, dt seconds after the last: what became of commands."""
    s = task.tracking.motors
    keep, blend = np.exp(-dt / _MEMORY), min(_OBSERVER * dt, _OBSERVER_MAX)
    for k in range(tachometer.shape[0]):
        speed = wheel_speed_used(belief, tachometer, k)
        is_new, s.speed[k] = speed != s.speed[k], speed
        spin = belief.wheel_inertia[k] * (s.speed[k] + along_axis(belief.axes, k, omega))
        shown = belief.stuck[k] == 0 and abs(s.speed[k]) < _AT_LIMIT * task.wheel_speed_max[k]
        if s.gain[k] == 0.0:
            _estimate(s, k)
        elif shown and s.begun[k] != 0:
            moved = (spin - s.spin[k]) / (dt * task.torque_max[k])
            if is_new and s.held[k] >= s.prompt and abs(s.commanded[k]) > _FREE * s.friction[k]:
                _test_for_jump(s, k, moved, dt)
            if s.held[k] >= s.settled:
                _learn(s, k, moved, keep)
                unexplained = s.gain[k] * s.commanded[k] - s.friction[k] * np.sign(s.speed[k]) - moved
                s.missing[k] += blend * (unexplained - s.missing[k])
        s.held[k] = s.held[k] + dt if s.begun[k] != 0 else 0.0
        s.spin[k], s.begun[k] = spin, 1 if shown else 0


@inline
def command(task, torque):
    """Turn the torque (n,) that the wheels are to feel into what the motors are commanded, within their limits."""
    s = task.tracking.motors
    for k in range(torque.shape[0]):
        limit = task.torque_max[k]
        wanted = torque[k] + limit * (s.friction[k] * np.sign(s.speed[k]) + s.missing[k])
        if s.gain[k] >= LOST:
            wanted /= s.gain[k]
        torque[k] = min(max(wanted, -limit), limit)
        if abs(torque[k] / limit - s.commanded[k]) >= _HELD:
            s.held[k] = 0.0
        s.commanded[k] = torque[k] / limit


@inline
def forget_last(s):
    """Begin again after a time in which no torque was commanded; estimates stay."""
    for k in range(s.begun.shape[0]):
        s.begun[k] = 0
        s.commanded[k] = 0.0
