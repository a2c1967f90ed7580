"""Rotation: attitude as a unit quaternion q from body to inertial frame, scalar last, and small turns of it."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import add, axpy, cross, norm
from satid_gym.core.jit import inline, outline


@inline
def to_body(q, v):
    """An inertial vector in the body frame."""
    a = (-q[0], -q[1], -q[2])
    t = cross(a, v)
    t = (2.0 * t[0], 2.0 * t[1], 2.0 * t[2])
    return add(axpy(q[3], t, v), cross(a, t))


@inline
def to_inertial(q, v):
    """A vector of the body frame in the inertial one."""
    return to_body((-q[0], -q[1], -q[2], q[3]), v)


@outline
def symmetric_to_inertial(q, s):
    """R S R^T (symmetric) of a symmetric S in the body frame."""
    x, y, z = to_inertial(q, (s[0], s[3], s[4])), to_inertial(q, (s[3], s[1], s[5])), to_inertial(q, (s[4], s[5], s[2]))
    a, b, c = to_inertial(q, (x[0], y[0], z[0])), to_inertial(q, (x[1], y[1], z[1])), to_inertial(q, (x[2], y[2], z[2]))
    return a[0], b[1], c[2], a[1], a[2], b[2]


@inline
def product(p, q):
    """Quaternion p * q: the turn q, then p."""
    return (
        p[3] * q[0] + q[3] * p[0] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] + q[3] * p[1] + p[2] * q[0] - p[0] * q[2],
        p[3] * q[2] + q[3] * p[2] + p[0] * q[1] - p[1] * q[0],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


@inline
def turn(v):
    """Quaternion of a rotation vector v, rad."""
    half = 0.5 * norm(v)
    s = 0.5 * np.sin(half) / half if half > 0.0 else 0.5
    return s * v[0], s * v[1], s * v[2], np.cos(half)


@inline
def rotation_vector(q):
    """Rotation vector of a small turn q, rad: the least of the two that it stands for; twice the sine of its half."""
    s = 2.0 if q[3] >= 0.0 else -2.0
    return s * q[0], s * q[1], s * q[2]


@inline
def load_quaternion(a):
    """The four numbers of an array, of length 1."""
    k = 1.0 / np.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2 + a[3] ** 2)
    return k * a[0], k * a[1], k * a[2], k * a[3]


@inline
def store_quaternion(a, q):
    """Write the four numbers."""
    a[0], a[1], a[2], a[3] = q
