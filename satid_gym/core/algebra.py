"""Algebra of 3-vectors (tuples) and symmetric 3 x 3 matrices; for factors of larger ones see `factors`.

A symmetric matrix is the tuple (xx, yy, zz, xy, xz, yz): the order of the full inertia parameters.
"""

from __future__ import annotations

from satid_gym.core.jit import inline

_FLAT = 1e-9  # of the trace: slack for bodies without thickness


@inline
def load(a):
    """The 3-vector in an array."""
    return a[0], a[1], a[2]


@inline
def store(a, v):
    """Write a 3-vector into an array."""
    a[0], a[1], a[2] = v


@inline
def load_symmetric(a):
    """The symmetric matrix in an array (3, 3)."""
    return a[0, 0], a[1, 1], a[2, 2], a[0, 1], a[0, 2], a[1, 2]


@inline
def store_symmetric(a, s):
    """Write a symmetric matrix into an array (3, 3)."""
    a[0, 0], a[1, 1], a[2, 2] = s[0], s[1], s[2]
    a[0, 1] = a[1, 0] = s[3]
    a[0, 2] = a[2, 0] = s[4]
    a[1, 2] = a[2, 1] = s[5]


@inline
def add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inline
def subtract(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def axpy(k, a, b):
    """k a + b."""
    return k * a[0] + b[0], k * a[1] + b[1], k * a[2] + b[2]


@inline
def scale(a, b):
    """Component by component a times b."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inline
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def dot(a, b):
    """Inner product of 3-vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def norm(v):
    """Length of a 3-vector."""
    return dot(v, v) ** 0.5


@inline
def multiply(s, v):
    """Symmetric matrix times vector."""
    return (
        s[0] * v[0] + s[3] * v[1] + s[4] * v[2],
        s[3] * v[0] + s[1] * v[1] + s[5] * v[2],
        s[4] * v[0] + s[5] * v[1] + s[2] * v[2],
    )


@inline
def axpy_symmetric(k, a, b):
    """k a + b for symmetric matrices."""
    return (
        k * a[0] + b[0],
        k * a[1] + b[1],
        k * a[2] + b[2],
        k * a[3] + b[3],
        k * a[4] + b[4],
        k * a[5] + b[5],
    )


@inline
def scale_symmetric(k, s):
    """k S for a symmetric matrix."""
    return k * s[0], k * s[1], k * s[2], k * s[3], k * s[4], k * s[5]


@inline
def add_diagonal(k, s):
    """k 1 + S."""
    return k + s[0], k + s[1], k + s[2], s[3], s[4], s[5]


@inline
def frobenius_square(s):
    """Sum of the squares of all nine elements of a symmetric matrix."""
    return s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + 2.0 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5])


@inline
def determinant(s):
    return s[0] * (s[1] * s[2] - s[5] * s[5]) - s[3] * (s[3] * s[2] - s[5] * s[4]) + s[4] * (s[3] * s[5] - s[1] * s[4])


@inline
def inverse(s):
    """Inverse of a symmetric matrix, by its adjugate."""
    xx = s[1] * s[2] - s[5] * s[5]
    xy = s[4] * s[5] - s[3] * s[2]
    xz = s[3] * s[5] - s[4] * s[1]
    k = 1.0 / (s[0] * xx + s[3] * xy + s[4] * xz)
    return (
        k * xx,
        k * (s[0] * s[2] - s[4] * s[4]),
        k * (s[0] * s[1] - s[3] * s[3]),
        k * xy,
        k * xz,
        k * (s[3] * s[4] - s[0] * s[5]),
    )


@inline
def congruence(b, a):
    """b a b for symmetric matrices (symmetric)."""
    c0 = multiply(a, (b[0], b[3], b[4]))
    c1 = multiply(a, (b[3], b[1], b[5]))
    c2 = multiply(a, (b[4], b[5], b[2]))
    r0, r1, r2 = multiply(b, c0), multiply(b, c1), multiply(b, c2)
    return r0[0], r1[1], r2[2], r0[1], r0[2], r1[2]


@inline
def is_positive_definite(s):
    """Sylvester's criterion on the leading minors."""
    return s[0] > 0.0 and s[0] * s[1] - s[3] * s[3] > 0.0 and determinant(s) > 0.0


@inline
def is_physical(s):
    """Whether a rigid body has this inertia tensor.

    Its matrix of second moments, tr(J)/2 1 - J, must be positive definite; its eigenvalues are half the
    excess in the three triangle inequalities of the principal moments. A flat plate, where one is zero, passes.
    """
    half = (0.5 + _FLAT) * (s[0] + s[1] + s[2])
    return is_positive_definite((half - s[0], half - s[1], half - s[2], -s[3], -s[4], -s[5]))


@inline
def largest_eigenvalue(a, size):
    """Largest eigenvalue of the symmetric matrix in a[:size, :size], which is overwritten (cyclic Jacobi)."""
    for _ in range(12):
        off = 0.0
        for p in range(size - 1):
            for q in range(p + 1, size):
                off = max(off, abs(a[p, q]) / (abs(a[p, p]) + abs(a[q, q]) + 1e-300))
                if a[p, q] == 0.0:
                    continue
                ratio = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
                t = 1.0 / (abs(ratio) + (ratio * ratio + 1.0) ** 0.5)
                if ratio < 0.0:
                    t = -t
                c = 1.0 / (t * t + 1.0) ** 0.5
                s = t * c
                for k in range(size):
                    akp, akq = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * akp - s * akq, s * akp + c * akq
                for k in range(size):
                    apk, aqk = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * apk - s * aqk, s * apk + c * aqk
        if off < 1e-15:
            break
    top = a[0, 0]
    for i in range(1, size):
        top = max(top, a[i, i])
    return top
