"""Coherence: growth of theta's variance where no reading tells of it, faster than that of the estimated random walk.

An inertia that moves goes on as it went for a while. Moving at v it is v T off after T seconds, so its variance grows
by 2 v^2 T a second. While readings tell of theta all the time a random walk of variance q a second stands for that.
In an imaging window, where the body rests, none tells; there the walk is too slow by far, and its variance is taken

    c = 2 T / T_u - 1 times,   but at least once

T is the mean age of what the estimate of theta rests on: it grows with time, and a reading that takes the share g of
theta's covariance away leaves 1 - g of it. T_u is its usual value, the mean over what was learned, so that c is 1 where
the walk was found. c is more than 1 only as far as theta moves beyond doubt, which grows in a long rest, and while it
is known to 5 %: updates of a theta that is coarse begin T again. Derivatives by q take c as given. Source: this
project's design.
"""

from __future__ import annotations

from satid_gym.core.jit import inline

_USUAL_AGE = 10.0  # s, T_u before the first reading
_USUAL_SHARE = 0.1  # of the way that T_u goes to T at a reading that takes all of theta's covariance away


@inline
def start(state):
    """T_u before the first reading; `state` is that of the adaptation."""
    state.usual_age = _USUAL_AGE


@inline
def forget(state):
    """Take theta as it is."""
    state.age = 0.0


@inline
def predict(state, dt, surely_moves):
    """Age by dt seconds; c of that time. `surely_moves`, within [0, 1], scales what exceeds 1."""
    state.age += dt
    return 1.0 + surely_moves * max(2.0 * state.age / state.usual_age - 2.0, 0.0)


@inline
def learn(state, taken):
    """T and T_u after an update that took the share `taken` (p, p) of theta's covariance away."""
    gain, p = 0.0, taken.shape[0]
    for i in range(p):
        gain += taken[i, i] / p
    gain = min(max(gain, 0.0), 1.0)  # beyond by rounding
    state.usual_age += _USUAL_SHARE * gain * (state.age - state.usual_age)
    state.age *= 1.0 - gain
