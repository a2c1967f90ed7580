"""Algebra of reaction wheels: axes, and sums of what each wheel contributes."""

from __future__ import annotations

from satid_gym.core.algebra import axpy, axpy_symmetric, dot, inverse, multiply
from satid_gym.core.jit import inline, outline


@inline
def wheel_axis(axes, k):
    """Spin axis of wheel k."""
    return axes[0, k], axes[1, k], axes[2, k]


@inline
def along_axis(axes, k, v):
    """Component of a body vector along the axis of wheel k."""
    return axes[0, k] * v[0] + axes[1, k] * v[1] + axes[2, k] * v[2]


@inline
def sum_wheels(axes, values):
    """A v: the sum in the body frame of one number for each wheel along its axis."""
    total = (0.0, 0.0, 0.0)
    for k in range(values.shape[0]):
        total = axpy(values[k], wheel_axis(axes, k), total)
    return total


@inline
def wheel_momentum(wheels, speed):
    """a = A j Omega of wheel speeds Omega (n,), N m s; `wheels` is a record with axes and wheel_inertia."""
    total = (0.0, 0.0, 0.0)
    for k in range(speed.shape[0]):
        total = axpy(wheels.wheel_inertia[k] * speed[k], wheel_axis(wheels.axes, k), total)
    return total


@inline
def is_in_band(speed, band):
    """Whether the speed of a wheel is within a band (low, high), in either direction, rad/s."""
    inside = False
    for k in range(speed.shape[0] if band[1] > band[0] else 0):
        inside = inside or band[0] <= abs(speed[k]) <= band[1]
    return inside


@inline
def reachable(axes, values):
    """|A| v: the most that wheels of up to values (n,) each can add up to along each body axis."""
    total = (0.0, 0.0, 0.0)
    for k in range(values.shape[0]):
        x, y, z = wheel_axis(axes, k)
        total = axpy(values[k], (abs(x), abs(y), abs(z)), total)
    return total


@outline
def speed_shares(wheels, speed, speed_max, inertia, rates):
    """Largest share of its speed limit that a wheel has now, and the largest that rates within the limit can take.

    `rates` is (omega, limit about each axis). The wheels take up the body's momentum J omega by least norm, v_k being
    row k of A's pseudo-inverse, and what they spin against each other stays:

        j_k Omega_k' = j_k Omega_k + v_k J (omega - omega')
    """
    omega, rate_limit = rates
    gram = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(speed.shape[0]):
        x, y, z = wheel_axis(wheels.axes, k)
        gram = axpy_symmetric(1.0, (x * x, y * y, z * z, x * y, x * z, y * z), gram)
    gram_inv = inverse(gram)
    now = worst = 0.0
    for k in range(speed.shape[0]):
        now = max(now, abs(speed[k]) / speed_max[k])
        x, y, z = multiply(inertia, multiply(gram_inv, wheel_axis(wheels.axes, k)))  # v_k J
        at_rest = wheels.wheel_inertia[k] * speed[k] + dot((x, y, z), omega)
        swing = rate_limit * (abs(x) + abs(y) + abs(z))
        worst = max(worst, (abs(at_rest) + swing) / (wheels.wheel_inertia[k] * speed_max[k]))
    return now, worst
