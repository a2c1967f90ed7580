"""Algebra of reaction wheels: axes, and sums of what each wheel contributes."""

from __future__ import annotations

from satid_gym.core.algebra import (
    axpy,
)
from satid_gym.core.jit import inline


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
