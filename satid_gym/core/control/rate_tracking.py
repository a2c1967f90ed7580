"""Rate tracking: wheel torque, sample by sample, that makes the body rate follow a reference.

The torque that the wheels are to feel (n,) is

    u = A^+ (tau + M x omega - k (J - A j A^T) (omega_ref - omega)) - N h / T_N

with A^+ the pseudo-inverse of their axes by which each motor takes a part as it is strong.

k, the bandwidth, is low enough for the phase of a late command to leave every bending mode damped: a torque that
opposes the rate at its own place takes energy out of a mode as long as it is less than a quarter of the mode's period
late. A change of omega_ref leaves a mode ringing by how steep it is; a scenario's `reference_slope` is the steepest.
N projects on the torques that cancel each other; of more than three wheels those that turn against each other
are brought to share the momentum evenly. Where operators avoid a band of wheel speed, N h - z v takes the place of N h,
which keeps them out of it (`core.control.null_motion`). Where all that takes more than the motors have, the error is
reduced axis by axis (`allocation.within_reach`), but first comes what keeps the axes inside the rate limit that have
reached it: otherwise noise drives them out while others turn. What the motors are commanded allows for a weak one and
for friction, as their wheels have shown them (`core.control.motors`); a wheel of three that is lost leaves an axis to
the momentum (`core.control.lost_axis`).

Only belief and readings are used. Source: Wie, Space Vehicle Dynamics and Control (2008), ch. 7, for the law; Preumont,
Vibration Control of Active Structures (2011), ch. 4, for what delay does to collocated control.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import (
    add,
    axpy_symmetric,
    cross,
    inverse,
    load,
    load_symmetric,
    multiply,
    norm,
    scale_symmetric,
    subtract,
)
from satid_gym.core.belief import filters
from satid_gym.core.belief.kalman import estimated_inertia
from satid_gym.core.control import motors
from satid_gym.core.control.allocation import allocate, fits, storable, within_reach
from satid_gym.core.control.lost_axis import constrain
from satid_gym.core.control.motors import LOST, motors_dtype
from satid_gym.core.control.null_motion import AWAY, choose, null_dtype
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.wheels import sum_wheels

_EVEN_OUT = 20.0  # T_N, s
_EDGE = 0.97  # of the rate limit: near enough to be used, far enough for noise
_HEALTHY = 0.6  # gain of each motor without which torques would not cancel each other


@functools.cache
def tracking_dtype(n: int) -> np.dtype:
    """Settings and state of the loop."""
    return np.dtype(
        [
            ("on", INT),  # 0: actions are wheel torque
            ("bandwidth", FLOAT),  # k, rad/s
            ("allocation", FLOAT, (n, 3)),  # pseudo-inverse of the axes
            ("sharing", FLOAT, (n, 3)),  # A^+
            ("reach", FLOAT, n),  # torque that a motor has, N m
            ("rotor_inertia", FLOAT, (3, 3)),  # A j A^T, kg m^2
            ("spin_max", FLOAT, n),  # momentum that a wheel is led to at most, N m s: noise adds to it
            ("reference", FLOAT, 3),  # commanded rate, rad/s
            ("slope", FLOAT),  # at which omega_ref moves there, rad/s^2; 0: at once
            ("eased", FLOAT, 3),  # omega_ref of the last sample where it has a slope, rad/s
            ("motors", motors_dtype(n)),
            ("null", null_dtype(n)),
            ("scratch", FLOAT, n),
        ],
        align=True,
    )


@inline
def _share_by_gain(s, axes, limit):
    """Write what each motor has, and A^+ = G A^T (A G A^T)^-1 with G of the gains' squares.

    Returns the weakest motor.
    """
    weakest = 0
    xx = yy = zz = xy = xz = yz = 0.0
    for k in range(limit.shape[0]):
        gain = s.motors.gain[k]
        if gain < s.motors.gain[weakest]:
            weakest = k
        s.reach[k] = min(gain, 1.0) * limit[k]
        x, y, z = axes[0, k], axes[1, k], axes[2, k]
        g = gain * gain
        xx, yy, zz = xx + g * x * x, yy + g * y * y, zz + g * z * z
        xy, xz, yz = xy + g * x * y, xz + g * x * z, yz + g * y * z
    back = inverse((xx, yy, zz, xy, xz, yz))
    for k in range(limit.shape[0]):
        row = multiply(back, (axes[0, k], axes[1, k], axes[2, k]))
        for i in range(3):
            s.sharing[k, i] = s.motors.gain[k] ** 2 * row[i]
    return weakest


@inline
def _even_out(s, axes, momentum, torque):
    """Add torques that cancel each other: they even out the wheels' momenta, or keep wheels out of a band of speed.

    They take what the motors have left.
    """
    total, limit = sum_wheels(axes, s.motors.spin), s.reach
    left, bias, time = 1.0, 0.0, _EVEN_OUT
    if s.null.on != 0:
        bias, time = choose(s.null, s.allocation, s.spin_max, momentum), AWAY
    for k in range(torque.shape[0]):
        wanted = allocate(s.allocation, total, k) + bias * s.null.direction[k]
        s.scratch[k] = (wanted - s.motors.spin[k]) / time
        wanted = torque[k] + s.scratch[k]
        if abs(wanted) > limit[k]:
            left = min(left, max(limit[k] - abs(torque[k]), 0.0) / abs(s.scratch[k]))
    for k in range(torque.shape[0]):
        torque[k] += left * s.scratch[k]


@inline
def _ease(s, reference, dt):
    """omega_ref, rad/s, dt seconds after the last, on its way to a reference."""
    if s.slope == 0.0:
        return reference
    step = s.slope * dt
    for i in range(3):
        s.eased[i] += min(max(reference[i] - s.eased[i], -step), step)
    return load(s.eased)


@inline
def _lost_axis(s, weakest):
    """Unit vector about which no torque is left where a wheel of three is lost."""
    row = load(s.allocation[weakest])
    length = norm(row)
    return row[0] / length, row[1] / length, row[2] / length


@inline
def _held(omega, edge):
    """Change of the rate, rad/s, that brings each axis which is beyond an edge back to it."""
    x, y, z = omega
    return min(max(x, -edge), edge) - x, min(max(y, -edge), edge) - y, min(max(z, -edge), edge) - z


@inline
def _left(error, held, given):
    """What is left of an error once a part of what is to be held is given; nothing of less, or of what leads out."""
    if held == 0.0:
        return error
    return max(error - given, 0.0) if held > 0.0 else min(error - given, 0.0)


@inline
def _add(s, push, torque):
    """Add the wheels' parts of a torque on the body."""
    for k in range(torque.shape[0]):
        torque[k] += allocate(s.sharing, push, k)


@outline
def track(task, belief, gyro, tachometer, dt, torque):
    """Write to `torque` (n,), N m, what the motors are to give until the next readings; dt seconds after the last."""
    s, axes, limit = task.tracking, belief.axes, task.torque_max
    n = torque.shape[0]
    omega = filters.rate_used(belief, gyro)
    inertia = estimated_inertia(belief)
    momentum, tau = filters.momentum_and_torque(belief)
    motors.observe(task, belief, tachometer, omega, dt)
    for k in range(n):
        s.scratch[k] = belief.wheel_inertia[k] * s.motors.speed[k]
    weakest = _share_by_gain(s, axes, limit)
    reference = load(s.reference)
    if n == 3 and s.motors.gain[weakest] < LOST:
        state = (omega, momentum, inertia)
        reference = constrain(reference, _lost_axis(s, weakest), state, task.rate_limit)
    wheels = (axes, s.allocation, s.spin_max)
    wanted = storable(_ease(s, reference, dt), momentum, inertia, wheels, s.scratch)
    free = axpy_symmetric(-1.0, load_symmetric(s.rotor_inertia), inertia)
    scaled = scale_symmetric(-s.bandwidth, free)
    drift = add(tau, cross(momentum, omega))
    for k in range(n):
        torque[k] = allocate(s.sharing, drift, k)
    error = subtract(wanted, omega)
    held = _held(omega, _EDGE * task.rate_limit)
    beyond = held[0] != 0.0 or held[1] != 0.0 or held[2] != 0.0
    if beyond and not fits(multiply(scaled, error), s.sharing, torque, s.reach):
        given = within_reach(held, scaled, s.sharing, torque, s.reach)
        _add(s, multiply(scaled, given), torque)
        x, y, z = held
        error = (_left(error[0], x, given[0]), _left(error[1], y, given[1]), _left(error[2], z, given[2]))
    _add(s, multiply(scaled, within_reach(error, scaled, s.sharing, torque, s.reach)), torque)
    for k in range(n):
        torque[k] = min(max(torque[k], -s.reach[k]), s.reach[k])
    if n > 3 and s.motors.gain[weakest] > _HEALTHY:
        _even_out(s, axes, momentum, torque)
    motors.command(task, torque)
