"""Kalman algebra of both extended filters: covariance propagation, update, and the start-up of theta.

Both states are [v, theta, rest]: a 3-vector that moves (M or omega), the p inertia parameters, and what else
the filter carries. Only the rows of v, and of the modes' deflections and momenta, differ from identity in the
transition, so F P F^T costs O(size^2).
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import axpy_symmetric, is_positive_definite
from satid_gym.core.belief.modes import body_inertia_of, moving
from satid_gym.core.factors import factor
from satid_gym.core.jit import inline, inline_disjoint, outline_disjoint

_FLOOR = 0.05  # of the prior inertia: below it an estimate is not believed
_HALVINGS_MAX = 40
_CANCELLATION = 10.0  # predicted over measured variance beyond which P - K h P loses digits


@inline
def inertia_of(theta):
    """J(theta): the symmetric matrix of 3 principal moments, or of 6 parameters xx yy zz xy xz yz."""
    if theta.shape[0] == 3:
        return theta[0], theta[1], theta[2], 0.0, 0.0, 0.0
    return theta[0], theta[1], theta[2], theta[3], theta[4], theta[5]


@inline
def estimated_inertia(belief):
    """J of the filter's mean."""
    p = belief.prior_theta.shape[0]
    return inertia_of(belief.mean[3 : 3 + p])


@inline
def theta_covariance(belief, i, j):
    """Covariance of theta i and j: that of the state, and of the common factor that no excitation finds."""
    return belief.covariance[3 + i, 3 + j] + belief.scale_variance * belief.mean[3 + i] * belief.mean[3 + j]


@inline
def is_known_to(belief, relative):
    """Whether each moment's standard deviation is at most the share `relative` of the moment."""
    known = True
    for k in range(3):
        known = known and not belief.covariance[3 + k, 3 + k] > (relative * belief.mean[3 + k]) ** 2
    return known


@inline
def factor_theta(belief, work):
    """LDL^T of theta's covariance to work.block, and its determinant; see `factors.factor`."""
    p = belief.prior_theta.shape[0]
    for i in range(p):
        for j in range(i + 1):
            work.theta_covariance[i, j] = theta_covariance(belief, i, j)
    return factor(work.theta_covariance, 0, p, work.block)


@inline
def write_times_regressor(matrix, omega, out):
    """out (3, p) = matrix (3, 3) L(omega), where J omega = L(omega) theta."""
    x, y, z = omega
    for i in range(3):
        a, b, c = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        out[i, 0], out[i, 1], out[i, 2] = a * x, b * y, c * z
        if out.shape[1] == 6:
            out[i, 3] = a * y + b * x
            out[i, 4] = a * z + c * x
            out[i, 5] = b * z + c * y


@inline
def write_cross_times(v, s, out):
    """out (3, 3) = [v x] S for a symmetric S."""
    x, y, z = v
    out[0, 0], out[0, 1], out[0, 2] = y * s[4] - z * s[3], y * s[5] - z * s[1], y * s[2] - z * s[5]
    out[1, 0], out[1, 1], out[1, 2] = z * s[0] - x * s[4], z * s[3] - x * s[5], z * s[4] - x * s[2]
    out[2, 0], out[2, 1], out[2, 2] = x * s[3] - y * s[0], x * s[1] - y * s[3], x * s[5] - y * s[4]


@inline_disjoint
def multiply_rows(rows, matrix, out, count):
    """out = rows matrix, of the first `count` rows; a square matrix."""
    size = matrix.shape[0]
    for r in range(count):
        for j in range(size):
            out[r, j] = 0.0
        for k in range(size):
            for j in range(size):
                out[r, j] += rows[r, k] * matrix[k, j]


@inline_disjoint
def _weigh(weights, matrix, out):
    """out = matrix^T weights; a square matrix, and weights of which many may be 0."""
    for j in range(matrix.shape[0]):
        out[j] = 0.0
    for k in range(matrix.shape[0]):
        if weights[k] != 0.0:
            for j in range(matrix.shape[0]):
                out[j] += weights[k] * matrix[k, j]


@inline_disjoint
def _subtract_square(v, matrix):
    """matrix -= v v^T, of both triangles: that is vectorised, and as symmetric as one mirrored."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[0]):
            matrix[i, j] -= v[i] * v[j]


@inline
def propagate(belief, work, dt):
    """P = F P F^T + Q, with F's rows of `modes.moving` in work.transition and Q the random walks over dt."""
    covariance, transition, product = belief.covariance, work.transition, work.product
    size, moved = belief.mean.shape[0], 3 + 2 * belief.modes.coupling.shape[0]
    multiply_rows(transition, covariance, product, moved)
    for i in range(3):
        for j in range(i, 3):
            total = 0.0
            for k in range(size):
                total += product[i, k] * transition[j, k]
            covariance[i, j] = covariance[j, i] = total
        for j in range(3, size):
            covariance[i, j] = covariance[j, i] = product[i, j]
    for r in range(3, moved):
        i = moving(belief, r)
        for j in range(3, size):
            covariance[i, j] = covariance[j, i] = product[r, j]
    for r in range(3, moved):
        i = moving(belief, r)
        for q in range(r + 1):
            j, total = moving(belief, q), 0.0
            for k in range(size):
                total += product[r, k] * transition[q, k]
            covariance[i, j] = covariance[j, i] = total
    for i in range(size):
        covariance[i, i] += belief.walk[i] ** 2 * dt


@outline_disjoint
def update(belief, work, rows):
    """Condition on the whitened measurements in work.rows and work.innovation, one scalar at a time.

    Each scalar has unit noise: work.innovation[r] = work.rows[r] . (x - mean) + N(0, 1). Joseph's form
    (1 - K h) P (1 - K h)^T + K K^T, expanded so that P stays symmetric; its second half, which mends rounding, is left
    out where little cancels. Returns the normalised innovation squared, chi-square with `rows` degrees of freedom, and
    leaves the normalised innovation in work.normalised.
    """
    covariance, ph, gain, delta = belief.covariance, work.ph, work.gain, work.delta
    size = belief.mean.shape[0]
    nis = 0.0
    for i in range(size):
        delta[i] = 0.0
    for r in range(rows):
        h = work.rows[r]
        _weigh(h, covariance, ph)
        variance, innovation = 1.0, work.innovation[r]
        for k in range(size):
            variance += h[k] * ph[k]
            innovation -= h[k] * delta[k]
        nis += innovation * innovation / variance
        per_variance, per_std = 1.0 / variance, 1.0 / np.sqrt(variance)
        work.innovation_variance[r], work.normalised[r] = variance, innovation * per_std
        for i in range(size):
            gain[i] = ph[i] * per_variance
            delta[i] += gain[i] * innovation
            ph[i] *= per_std
        _subtract_square(ph, covariance)
        if variance < _CANCELLATION:
            continue
        # what cancellation left of P h, and how far that is from the gain that theory gives
        remainder = work.remainder
        _weigh(h, covariance, remainder)
        for i in range(size):
            remainder[i] = 0.5 * (remainder[i] - gain[i])
        for i in range(size):
            for j in range(i, size):
                change = remainder[i] * gain[j] + gain[i] * remainder[j]
                covariance[i, j] = covariance[j, i] = covariance[i, j] - change
    _move_mean(belief, work)
    return nis


@inline
def _move_mean(belief, work):
    """Add work.delta to the mean; shorten and count an update whose inertia would not be positive definite."""
    p = belief.prior_theta.shape[0]
    floor = inertia_of(belief.prior_theta)
    fraction = 1.0
    for _ in range(_HALVINGS_MAX):
        for k in range(p):
            work.theta[k] = belief.mean[3 + k] + fraction * work.delta[3 + k]
        inertia = body_inertia_of(belief, work, fraction, inertia_of(work.theta))
        if is_positive_definite(axpy_symmetric(-_FLOOR, floor, inertia)):
            break
        fraction *= 0.5
    if fraction < 1.0:
        belief.constrained_updates += 1
    for i in range(belief.mean.shape[0]):
        belief.mean[i] += fraction * work.delta[i]


@inline
def add_symmetric(k, a, matrix, first):
    """Add k A, of a symmetric A, to the block of a symmetric matrix that begins at (first, first)."""
    p, q, r = first, first + 1, first + 2
    matrix[p, p] += k * a[0]
    matrix[q, q] += k * a[1]
    matrix[r, r] += k * a[2]
    matrix[p, q] = matrix[q, p] = matrix[p, q] + k * a[3]
    matrix[p, r] = matrix[r, p] = matrix[p, r] + k * a[4]
    matrix[q, r] = matrix[r, q] = matrix[q, r] + k * a[5]


@inline
def clear(belief):
    """Mean and covariance zero."""
    for i in range(belief.mean.shape[0]):
        belief.mean[i] = 0.0
        for j in range(belief.mean.shape[0]):
            belief.covariance[i, j] = 0.0


@inline
def start_theta(belief):
    """Mean and covariance before the first reading: theta at its prior, everything else zero."""
    p = belief.prior_theta.shape[0]
    clear(belief)
    for k in range(p):
        belief.mean[3 + k] = belief.prior_theta[k]
        belief.covariance[3 + k, 3 + k] = belief.prior_theta_std[k] ** 2
    belief.constrained_updates = 0
    belief.broken = 0
