"""Motors as their wheels have shown them: the gain of each, and the Coulomb friction of its wheel.

For the momentum h = j (Omega + A^T omega) of a wheel under a commanded torque u

    dh/dt = g u - c sgn(Omega)

and (g, c) are its least-squares estimate from the samples so far, of which the older count less: R and b are the
information matrix and vector, in fractions of the torque limit and of one sample's information,

    R = L (R - R_0) + R_0 + phi phi^T,    b = L (b - R_0 (1, 0)) + R_0 (1, 0) + phi dh/dt,    phi = (u, -sgn Omega)

with L = exp(-dt / T) and R_0 of the prior. Source: Ljung, System Identification (1999), ch. 11.2.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.jit import inline
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.wheels import along_axis

_MEMORY = 30.0  # T, s
_HELD = 0.05  # of the torque limit, by which a command may differ from the one before
_SETTLED = 5  # samples without a larger change, after which a command that comes late does not matter
_PRIOR = (0.1, 1.0)  # R_0: the motors' noise of 5 % over what gain (30 %) and friction (10 % of the limit) may be
_OBSERVER = 0.5  # 1/s
_GAIN_MIN = 0.2  # below it no larger command makes up for a weak motor
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
            ("missing", FLOAT, n),  # what the model does not explain, low-pass filtered, of the torque limit
            ("commanded", FLOAT, n),  # u of the sample before, of the torque limit
            ("held", INT, n),  # samples for which it has been much the same
            ("spin", FLOAT, n),  # h then, N m s
            ("begun", INT),  # 1: there was a sample before
        ],
        align=True,
    )


@inline
def _estimate(s, k):
    """Write gain and friction of motor k."""
    a, b, c = s.information[k, 0] + _PRIOR[0], s.information[k, 1], s.information[k, 2] + _PRIOR[1]
    x, y = s.vector[k, 0] + _PRIOR[0], s.vector[k, 1]
    det = a * c - b * b
    s.gain[k] = max((c * x - b * y) / det, _GAIN_MIN)
    s.friction[k] = min(max((a * y - b * x) / det, 0.0), 1.0)


@inline
def observe(task, belief, speed, omega):
    """Take in the wheel speeds (n,), rad/s, at body rate omega: what became of the last commands."""
    s, dt = task.tracking.motors, task.sample_period
    keep = np.exp(-dt / _MEMORY)
    for k in range(speed.shape[0]):
        spin = belief.wheel_inertia[k] * (speed[k] + along_axis(belief.axes, k, omega))
        if s.begun == 0:
            _estimate(s, k)
        elif s.held[k] >= _SETTLED and abs(speed[k]) < _AT_LIMIT * task.wheel_speed_max[k]:
            moved, u, side = (spin - s.spin[k]) / (dt * task.torque_max[k]), s.commanded[k], -np.sign(speed[k])
            s.information[k, 0] = keep * s.information[k, 0] + u * u
            s.information[k, 1] = keep * s.information[k, 1] + u * side
            s.information[k, 2] = keep * s.information[k, 2] + side * side
            s.vector[k, 0] = keep * s.vector[k, 0] + u * moved
            s.vector[k, 1] = keep * s.vector[k, 1] + side * moved
            _estimate(s, k)
        if s.begun != 0 and abs(speed[k]) < _AT_LIMIT * task.wheel_speed_max[k]:
            moved = (spin - s.spin[k]) / (dt * task.torque_max[k])
            unexplained = s.gain[k] * s.commanded[k] - s.friction[k] * np.sign(speed[k]) - moved
            s.missing[k] += min(_OBSERVER * dt, 1.0) * (unexplained - s.missing[k])
        s.spin[k] = spin
    s.begun = 1


@inline
def command(task, speed, torque):
    """Turn the torque (n,) that the wheels are to feel into what the motors are commanded, within their limits."""
    s = task.tracking.motors
    for k in range(torque.shape[0]):
        limit = task.torque_max[k]
        wanted = (torque[k] + limit * (s.friction[k] * np.sign(speed[k]) + s.missing[k])) / s.gain[k]
        torque[k] = min(max(wanted, -limit), limit)
        change = abs(torque[k] / limit - s.commanded[k])
        s.held[k] = s.held[k] + 1 if change < _HELD else 0
        s.commanded[k] = torque[k] / limit
