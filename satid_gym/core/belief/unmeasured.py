"""Wheels whose speed is not measured, since their tachometer is stuck.

Such a wheel is assumed to follow its command, and may do otherwise by more than any motor can. The gyro then measures
M - a = J omega, and momentum, which the wheels cannot change, says what went into the wheel: an update's part along its
axis is taken as motion of the wheel. Along that axis the covariance is that of M - a, which does not depend on how an
update is shared between the two. M itself is known there, so that its part in M x omega has no error: else the filter
would learn from it of the inertia about that axis, of which no reading tells.

Source: this project's design.
"""

from __future__ import annotations

from satid_gym.core.algebra import axpy, cross, dot, load, multiply, store, subtract
from satid_gym.core.jit import inline, outline
from satid_gym.core.rotation import to_inertial
from satid_gym.core.wheels import along_axis, wheel_axis

STUCK, RECOVERED = 1, 2  # tachometer repeats itself; did so until the last reading
_TORQUE_FACTOR = 10.0  # spin of a wheel without tachometer, over its motor's: less would tell of J
_PARALLEL = 1e-12  # square of the sine of an angle between axes


@inline
def shift(belief, k, spin):
    """Add `spin` N m s about the axis of wheel k to M and to A j Omega; M - A j Omega stays."""
    axis, change = wheel_axis(belief.axes, k), spin / belief.wheel_inertia[k]
    belief.speed[k] += change
    belief.gate.speed[k] += change
    for line in range(belief.alignment.wheel_line.shape[0]):
        belief.alignment.wheel_line[line, k] += change
    store(belief.mean, axpy(spin, axis, load(belief.mean)))
    store(belief.wheel_input, axpy(spin, axis, load(belief.wheel_input)))


@inline
def is_any_stuck(belief):
    """Whether a tachometer is stuck."""
    stuck = False
    for k in range(belief.stuck.shape[0]):
        stuck = stuck or belief.stuck[k] == STUCK
    return stuck


@inline
def along_axes(belief, v):
    """Part of a vector in what the axes of the wheels without tachometer span."""
    rest, found = v, 0
    first = second = (0.0, 0.0, 0.0)
    for k in range(belief.stuck.shape[0]):
        if belief.stuck[k] == STUCK and found < 3:
            axis = wheel_axis(belief.axes, k)
            axis = axpy(-dot(first, axis), first, axpy(-dot(second, axis), second, axis))
            square = dot(axis, axis)
            if square > _PARALLEL:  # orthonormal, one after another
                length = square**0.5
                axis = axis[0] / length, axis[1] / length, axis[2] / length
                rest = axpy(-dot(axis, rest), axis, rest)
                first, second, found = axis, first, found + 1
    return subtract(v, rest)


@inline
def hold_total(belief, omega, jacobian):
    """Take M along the axis of a wheel without tachometer as known in d(M x omega) / dM, `jacobian` (3, 3).

    The error of M - a there, which the covariance has, is that of the wheel: M itself goes on as it was.
    """
    for j in range(3):
        unit = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
        turned = cross(omega, along_axes(belief, unit))
        for i in range(3):
            jacobian[i, j] += turned[i]


@outline
def inflate_momentum(belief, J_inv, dt):
    """Add to M and attitude what wheels without tachometer may have done in the dt seconds of a prediction.

    Spin s taken up evenly moves M - a by -s (A_k + dt / 2 M x J^-1 A_k), and psi by -s dt / 2 R J^-1 A_k.
    """
    covariance, state = belief.covariance, belief.attitude
    for k in range(belief.stuck.shape[0]):
        if belief.stuck[k] != 0:
            axis = wheel_axis(belief.axes, k)
            rate = multiply(J_inv, axis)
            g = axpy(0.5 * dt, cross(load(belief.mean), rate), axis)
            variance = (_TORQUE_FACTOR * belief.gate.torque_max[k] * dt) ** 2
            for i in range(3):
                for j in range(i, 3):
                    covariance[i, j] = covariance[j, i] = covariance[i, j] + variance * g[i] * g[j]
            if state.boresight.shape[0] > 0 and state.known != 0:
                turn = to_inertial(state.quaternion, axpy(0.5 * dt, rate, (0.0, 0.0, 0.0)))
                for i in range(3):
                    for j in range(3):
                        both = covariance[i, state.first + j] + variance * g[i] * turn[j]
                        covariance[i, state.first + j] = covariance[state.first + j, i] = both
                        covariance[state.first + i, state.first + j] += variance * turn[i] * turn[j]


@inline
def follow(belief, momentum):
    """After an update that began at `momentum`, take its part along the axis of an unmeasured wheel as spin."""
    for k in range(belief.stuck.shape[0]):
        if belief.stuck[k] == STUCK:
            spin = -along_axis(belief.axes, k, subtract(load(belief.mean), momentum))
            shift(belief, k, spin)
