"""Announced change of the inertia: what a filter does that is told of a deployment or release when it is commanded.

Who commands it knows when, and how long it takes, but not what it does to the tensor. A share c of the change, that of
the time that passed, adds the covariance S = c s^2 diag(scale)^2 to theta, s the relative size it may have. A
deployment keeps M; what is released takes its angular momentum along, so that the rate stays and M changes by
L(omega) dtheta (`inertia_change`).

Source: this project's design.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import multiply
from satid_gym.core.belief import inertia_change, momentum_model
from satid_gym.core.jit import inline, outline

_SIZE = 0.2  # s: std of all of a change, relative to the scale of theta


@inline
def tell(belief, share, leaves):
    """Announce that `share` of a change comes before the next reading; leaves: 1 if a mass leaves with its momentum."""
    belief.announced = share if belief.is_told != 0 else 0.0
    belief.leaves = leaves


@inline
def size(belief):
    """Std of what has been announced for this sample, relative to the scale of theta."""
    return _SIZE * np.sqrt(belief.announced)


@outline
def raise_covariance(belief, work):
    """Add what has been announced to the covariance of momentum and theta."""
    omega = multiply(momentum_model.inverse_inertia(belief), momentum_model.body_momentum(belief))
    inertia_change.write_regressor(work, omega)
    inertia_change.add(belief, work, size(belief), 1.0 if belief.leaves != 0 else 0.0)
    if belief.leaves == 0:
        belief.stepped = 1
