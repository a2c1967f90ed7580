"""Motors as their wheels have shown them: the gain of each, and the Coulomb friction of its wheel.

For the momentum h = j (Omega + A^T omega) of a wheel under a commanded torque u

    dh/dt = g u - c sgn(Omega)

and (g, c) are its least-squares estimate from the samples so far, of which the older count less: R and b are the
information matrix and vector, in fractions of the torque limit and of one sample's information,

    R = L (R - R_0) + R_0 + phi phi^T,    b = L (b - R_0 (1, 0)) + R_0 (1, 0) + phi dh/dt,    phi = (u, -sgn Omega)

with L = exp(-dt / T) and R_0 of the prior. A command counts once it has been much the same for as long as it may come
late; a wheel whose tachometer is stuck, or that is at its speed limit, shows nothing of it.
Source: Ljung, System Identification (1999), ch. 11.2.
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
_OBSERVER = 0.5  # 1/s
_GAINS = (0.2, 2.0)  # below these no larger command makes up for a weak motor
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
    x, y = s.vector[k, 0] + s.prior[k, 0], s.vector[k, 1]
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
def observe(task, belief, tachometer, omega, dt):
    """Take in the tachometers (n,), rad/s, at body rate omega, dt seconds after the last: what became of commands."""
    s = task.tracking.motors
    keep, blend = np.exp(-dt / _MEMORY), min(_OBSERVER * dt, 1.0)
    for k in range(tachometer.shape[0]):
        s.speed[k] = wheel_speed_used(belief, tachometer, k)
        spin = belief.wheel_inertia[k] * (s.speed[k] + along_axis(belief.axes, k, omega))
        shown = belief.stuck[k] == 0 and abs(s.speed[k]) < _AT_LIMIT * task.wheel_speed_max[k]
        if s.gain[k] == 0.0:
            _estimate(s, k)
        elif shown and s.begun[k] != 0 and s.held[k] >= s.settled:
            moved = (spin - s.spin[k]) / (dt * task.torque_max[k])
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
        wanted = (torque[k] + limit * (s.friction[k] * np.sign(s.speed[k]) + s.missing[k])) / s.gain[k]
        torque[k] = min(max(wanted, -limit), limit)
        if abs(torque[k] / limit - s.commanded[k]) >= _HELD:
            s.held[k] = 0.0
        s.commanded[k] = torque[k] / limit


@inline
def forget_last(s):
    """Begin anew after a time in which no torque was commanded; estimates stay."""
    for k in range(s.begun.shape[0]):
        s.begun[k] = 0
        s.commanded[k] = 0.0
