"""Rate noise: what noise of the body rate does to a prediction of M, deflections and attitude, which follow it alike.

An error e of the rate moves M by M x e, a deflection by -d . e, and the attitude by R e, times the seconds it lasts.
"""

from __future__ import annotations

from satid_gym.core.algebra import axpy, dot, load, multiply
from satid_gym.core.belief.kalman import add_symmetric, write_cross_times
from satid_gym.core.belief.modes import moving
from satid_gym.core.jit import inline, outline
from satid_gym.core.rotation import symmetric_to_inertial, to_inertial


@inline
def add(belief, work, momentum, noise, h2):
    """Add it to the covariance.

    Args:
        belief: belief; where the attitude is known, that after the prediction.
        work: scratch space.
        momentum: M of the prediction.
        noise: covariance S of the rate's error in a sample (symmetric).
        h2: s^2; h dt for a step of h seconds within a sample of dt seconds.
    """
    if belief.modes.coupling.shape[0] > 0:
        _add_to_modes(belief, momentum, noise, h2)
    else:
        _add_to_momentum(belief, work, momentum, noise, h2)
    if belief.attitude.boresight.shape[0] > 0 and belief.attitude.known != 0:
        _add_to_attitude(belief, work, momentum, noise, h2)


@inline
def _add_to_momentum(belief, work, momentum, noise, h2):
    """P_MM += h2 [M x] S [M x]^T."""
    half = work.jacobian[2]
    write_cross_times(momentum, noise, half)
    x, y, z = momentum
    for i in range(3):
        a, b, c = h2 * half[i, 0], h2 * half[i, 1], h2 * half[i, 2]
        row = (c * y - b * z, a * z - c * x, b * x - a * y)
        for j in range(i, 3):
            belief.covariance[i, j] = belief.covariance[j, i] = belief.covariance[i, j] + row[j]


@outline
def _add_to_modes(belief, momentum, noise, h2):
    """The same of M and deflections."""
    m = 3 + 2 * belief.modes.coupling.shape[0]
    for a in range(m):
        if a >= 3 and (a - 3) % 2 == 1:
            continue
        left = multiply(noise, _by_rate(belief, momentum, a))
        for b in range(a, m):
            if b >= 3 and (b - 3) % 2 == 1:
                continue
            i, j = moving(belief, a), moving(belief, b)
            belief.covariance[i, j] += h2 * dot(left, _by_rate(belief, momentum, b))
            belief.covariance[j, i] = belief.covariance[i, j]


@inline
def _by_rate(belief, momentum, r):
    """Derivative of the r-th state that moves, in the order of `moving`, by an error of the rate in a second."""
    if r >= 3:
        return axpy(-1.0, load(belief.modes.d[(r - 3) // 2]), (0.0, 0.0, 0.0))
    x, y, z = momentum
    if r == 0:
        return 0.0, -z, y
    if r == 1:
        return z, 0.0, -x
    return -y, x, 0.0


@outline
def _add_to_attitude(belief, work, momentum, noise, h2):
    """P_pp += h2 R S R^T, P_Mp += h2 [M x] S R^T, and of each mode P_ep -= h2 d^T S R^T."""
    covariance, first, crossed = belief.covariance, belief.attitude.first, work.jacobian[2]
    q = belief.attitude.quaternion
    write_cross_times(momentum, noise, crossed)
    add_symmetric(h2, symmetric_to_inertial(q, noise), covariance, first)
    for i in range(3):
        row = to_inertial(q, (crossed[i, 0], crossed[i, 1], crossed[i, 2]))
        for j in range(3):
            both = covariance[i, first + j] + h2 * row[j]
            covariance[i, first + j] = covariance[first + j, i] = both
    for k in range(belief.modes.coupling.shape[0]):
        at, row = moving(belief, 3 + 2 * k), to_inertial(q, multiply(noise, load(belief.modes.d[k])))
        for j in range(3):
            both = covariance[at, first + j] - h2 * row[j]
            covariance[at, first + j] = covariance[first + j, at] = both
