"""Factors LDL^T of small positive definite matrices: determinant, inverse, Mahalanobis distance.

Source: Golub and Van Loan, Matrix Computations (2013), ch. 4.
"""

from __future__ import annotations

from satid_gym.core.jit import inline


@inline
def factor(a, first, size, work):
    """LDL^T of the block a[first : first + size] squared; D and L go to `work`, the product of D returns.

    The product is the block's determinant; it is not positive where a pivot is not, and then `work` is void.
    """
    product = 1.0
    for j in range(size):
        pivot = a[first + j, first + j]
        for k in range(j):
            pivot -= work[j, k] * work[j, k] * work[k, k]
        if not pivot > 0.0:
            return -1.0
        work[j, j] = pivot
        product *= pivot
        for i in range(j + 1, size):
            value = a[first + i, first + j]
            for k in range(j):
                value -= work[i, k] * work[j, k] * work[k, k]
            work[i, j] = value / pivot
    return product


@inline
def invert(work, size, out):
    """out = A^-1 for the matrix that `factor` left in `work`, of which D and the upper triangle are overwritten."""
    for j in range(size):  # L^-1, of which row i stands in column i of the upper triangle
        for i in range(j + 1, size):
            total = -work[i, j]
            for k in range(j + 1, i):
                total -= work[i, k] * work[j, k]
            work[j, i] = total
        work[j, j] = 1.0 / work[j, j]
    for i in range(size):
        for j in range(i, size):
            total = 0.0
            for k in range(j, size):
                left = 1.0 if i == k else work[i, k]
                right = 1.0 if j == k else work[j, k]
                total += left * right * work[k, k]
            out[i, j] = out[j, i] = total


@inline
def mahalanobis(work, error, size):
    """e^T A^-1 e for the matrix that `factor` left in `work`; `error` (size,) is overwritten."""
    total = 0.0
    for i in range(size):
        for k in range(i):
            error[i] -= work[i, k] * error[k]
        total += error[i] * error[i] / work[i, i]
    return total


@inline
def factored_inverse(s):
    """Inverse of a symmetric matrix by LDL^T, and the least of D; void where that is not positive.

    Where the matrix is ill-conditioned the adjugate cancels, this does not.
    """
    x = 1.0 / s[0]
    b, c = s[3] * x, s[4] * x  # L's first column
    first = s[1] - b * s[3]
    y = 1.0 / first
    rest = s[5] - b * s[4]
    a = rest * y
    second = s[2] - c * s[4] - a * rest
    z = 1.0 / second
    corner = a * b - c
    inverted = (
        x + b * b * y + corner * corner * z,
        y + a * a * z,
        z,
        -b * y - corner * a * z,
        corner * z,
        -a * z,
    )
    return inverted, min(s[0], first, second)
