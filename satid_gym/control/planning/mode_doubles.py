"""Doubles of modes: how far the body may bend where its frequencies are not those that the filter expects.

Each mode has two doubles, one slower and one faster than its estimate by `caution` standard deviations. They begin as
the estimate is and are driven by the same change of the body rate,

    d2 eta/dt2 = -w^2 eta - 2 zeta w deta/dt - d . domega/dt

and no reading corrects them: a bend to come does not shrink because more of it will be known then.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import dot, load
from satid_gym.core.belief import filters, modes
from satid_gym.core.jit import inline, outline

FIELDS = 3  # eta, its rate, w


@outline
def begin(belief, doubles, caution):
    """Write the doubles (modes, 2, FIELDS) of a belief, `caution` standard deviations of log w off."""
    omega = filters.rate(belief)
    for i in range(doubles.shape[0]):
        at = belief.modes.first + modes.STATES * i
        spread = caution * np.sqrt(belief.covariance[at + 2, at + 2])
        for side in range(2):
            doubles[i, side, 0], doubles[i, side, 1] = belief.mean[at], modes.deflection_rate(belief, i, omega)
            doubles[i, side, 2] = belief.modes.w[i] * np.exp(spread if side == 1 else -spread)


@inline
def _kick(eta, speed, w, zeta, push, h):
    """Deflection rate after h seconds of spring and damper, and a push."""
    return speed - push - h * (w * w * eta + 2.0 * zeta * w * speed)


@outline
def bend(belief, doubles, turned, dt):
    """Move the doubles on by dt seconds in which the body rate changes by `turned`, by Stoermer and Verlet's method.

    Returns their largest deflection over its limit.
    """
    largest = 0.0
    for i in range(doubles.shape[0]):
        zeta, push = belief.modes.zeta[i], 0.5 * dot(load(belief.modes.d[i]), turned)
        for side in range(2):
            eta, speed, w = load(doubles[i, side])
            speed = _kick(eta, speed, w, zeta, push, 0.5 * dt)
            eta += dt * speed
            doubles[i, side, 0], doubles[i, side, 1] = eta, _kick(eta, speed, w, zeta, push, 0.5 * dt)
            largest = max(largest, abs(eta) / modes.limit_of(belief, i))
    return largest
