"""Change of the inertia, announced or found: what it adds to the covariance of momentum and theta.

With S the covariance of the change, and of M's error either nothing, for M stays where the inertia alone changes, or
that of a momentum L(omega) theta which is known to be that of the rate omega; `share` is the probability of the latter:

    P_tt += S,   P_Mt += share L S,   P_MM += share L S L^T

Source: this project's design.
"""

from __future__ import annotations

from satid_gym.core.algebra import store_symmetric
from satid_gym.core.belief.kalman import write_times_regressor
from satid_gym.core.jit import inline, outline


@inline
def write_regressor(work, omega):
    """L(omega) to work.regressor (3, p)."""
    store_symmetric(work.jacobian[0], (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    write_times_regressor(work.jacobian[0], omega, work.regressor)


@outline
def add(belief, work, size, share):
    """Add a change of std `size`, relative to the scale of theta, with L(omega) in work.regressor."""
    covariance, regressor = belief.covariance, work.regressor
    for k in range(belief.theta_scale.shape[0]):
        variance = (size * belief.theta_scale[k]) ** 2
        covariance[3 + k, 3 + k] += variance
        for i in range(3 if share > 0.0 else 0):
            moved = share * regressor[i, k] * variance
            covariance[i, 3 + k] += moved
            covariance[3 + k, i] += moved
            for j in range(3):
                covariance[i, j] += moved * regressor[j, k]
