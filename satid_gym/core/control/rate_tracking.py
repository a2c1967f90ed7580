"""Rate tracking: wheel torque, sample by sample, that makes the body rate follow a reference.

The torque on the wheels, (n,) with A^+ the pseudo-inverse of their axes, is

    u = A^+ (tau + M x omega - k (J - A j A^T) (omega_ref - omega)) + f - N h / T_N

k, the bandwidth, is low enough for the phase of a late command to leave every bending mode damped: a torque that
opposes the rate at its own place takes energy out of a mode as long as it is less than a quarter of the mode's period
late. What a wheel owes, f, is the part of its command that its momentum h = j (Omega + A^T omega) did not show, by
friction or a weak motor: a first-order observer, df/dt = k_f (u - dh/dt - f). N projects on the torques that cancel
each other; of more than three wheels those that turn against each other are brought to share the momentum evenly.
Where all that takes more than the motors have, the error is reduced axis by axis (`allocation.within_reach`).

Only belief and readings are used. Source: Wie, Space Vehicle Dynamics and Control (2008), ch. 7, for the law; Preumont,
Vibration Control of Active Structures (2011), ch. 4, for what delay does to collocated control.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import add, axpy_symmetric, cross, load, load_symmetric, multiply, scale_symmetric, subtract
from satid_gym.core.belief import filters
from satid_gym.core.belief.kalman import estimated_inertia
from satid_gym.core.control.allocation import allocate, storable, within_reach
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.wheels import along_axis, sum_wheels

TRACKING_STEP_MAX = 0.5
"""Largest bandwidth times sample period: half of the way to the reference in a sample."""
_OBSERVER = 0.5  # k_f, 1/s
_EVEN_OUT = 20.0  # T_N, s
_AT_LIMIT = 0.999  # of the speed limit: from here on a wheel shows nothing of its command


@functools.cache
def tracking_dtype(n: int) -> np.dtype:
    """Settings and state of the loop."""
    return np.dtype(
        [
            ("on", INT),  # 0: actions are wheel torque
            ("bandwidth", FLOAT),  # k, rad/s
            ("allocation", FLOAT, (n, 3)),  # A^+
            ("rotor_inertia", FLOAT, (3, 3)),  # A j A^T, kg m^2
            ("spin_max", FLOAT, n),  # momentum that a wheel may store, N m s
            ("reference", FLOAT, 3),  # omega_ref, rad/s
            ("owed", FLOAT, n),  # f, N m
            ("commanded", FLOAT, n),  # u of the sample before
            ("spin", FLOAT, n),  # h then, N m s
            ("begun", INT),  # 1: there was a sample before
            ("scratch", FLOAT, (2, n)),
        ],
        align=True,
    )


@inline
def _observe_motors(task, belief, speed, omega):
    """Update what each wheel owes by what it did with its command of the sample before."""
    s, dt = task.tracking, task.sample_period
    for k in range(speed.shape[0]):
        spin = belief.wheel_inertia[k] * (speed[k] + along_axis(belief.axes, k, omega))
        if s.begun != 0 and abs(speed[k]) < _AT_LIMIT * task.wheel_speed_max[k]:
            missing = s.commanded[k] - (spin - s.spin[k]) / dt
            s.owed[k] += min(_OBSERVER * dt, 1.0) * (missing - s.owed[k])
        s.spin[k] = spin
    s.begun = 1


@inline
def _even_out(s, axes, limit, torque):
    """Add torques that cancel each other and even out the wheels' momenta, as far as the motors have some left."""
    total = sum_wheels(axes, s.spin)
    left = 1.0
    for k in range(torque.shape[0]):
        s.scratch[0, k] = (allocate(s.allocation, total, k) - s.spin[k]) / _EVEN_OUT
        wanted = torque[k] + s.scratch[0, k]
        if abs(wanted) > limit[k]:
            left = min(left, max(limit[k] - abs(torque[k]), 0.0) / abs(s.scratch[0, k]))
    for k in range(torque.shape[0]):
        torque[k] += left * s.scratch[0, k]


@outline
def track(task, belief, gyro, tachometer, torque):
    """Write to `torque` (n,), N m, what the motors are to give until the next readings."""
    s, axes, limit = task.tracking, belief.axes, task.torque_max
    n = torque.shape[0]
    omega = filters.rate_used(belief, gyro)
    inertia = estimated_inertia(belief)
    momentum, tau = filters.momentum_and_torque(belief)
    for k in range(n):
        s.scratch[1, k] = tachometer[k] if belief.stuck[k] == 0 else belief.speed[k]
    _observe_motors(task, belief, s.scratch[1], omega)
    for k in range(n):
        s.scratch[1, k] *= belief.wheel_inertia[k]
    wheels = (axes, s.allocation, s.spin_max)
    wanted = storable(load(s.reference), momentum, inertia, wheels, s.scratch[1], s.scratch[0])
    free = axpy_symmetric(-1.0, load_symmetric(s.rotor_inertia), inertia)
    scaled = scale_symmetric(-s.bandwidth, free)
    drift = add(tau, cross(momentum, omega))
    for k in range(n):
        torque[k] = allocate(s.allocation, drift, k) + s.owed[k]
    error = subtract(wanted, omega)
    push = multiply(scaled, within_reach(error, scaled, s.allocation, torque, limit, s.scratch[0]))
    for k in range(n):
        torque[k] = min(max(torque[k] + allocate(s.allocation, push, k), -limit[k]), limit[k])
    if n > 3:
        _even_out(s, axes, limit, torque)
    for k in range(n):
        s.commanded[k] = torque[k]
