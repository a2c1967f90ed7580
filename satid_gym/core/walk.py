"""How fast the inertia walks: what the AdaptiveEKF finds out beside theta, by recursive maximum likelihood.

theta walks with variance q a second, relative to its scale. An update that moves theta's mean by d and takes its
covariance from P- to P+ tells what a measurement of theta alone would; the derivative of that measurement's
log-likelihood by a parameter e of q, and the information on e, are

    score = u.t + (u^T D u - tr W D) / 2,   information = t^T W t + tr (W D)^2 / 2
    u = (P-)^-1 d,   W = (P-)^-1 - (P-)^-1 P+ (P-)^-1,   t = d theta / de,   D = dP / de before the update

and with A = P+ (P-)^-1 the update takes t to A (t + D u), D to A D A^T. (That M's error is theta's as well is left
out.) With w the slowest walk that matters

    q / w^2 = exp(e) for e >= 0,   1 + e for -1 <= e < 0

so that theta may also not walk at all; lest the estimate's noise be taken for a walk, the filter takes 1 + e less -e
times _DOUBT standard deviations of e. The parameter is taken to walk itself: its variance falls with the information
and grows with time. An innovation that no walk explains is a step of the inertia: theta's covariance is raised before
the update.
Source: Mehra, Approaches to adaptive filtering (1972); Ljung and Soderstrom, Theory and practice of recursive
identification (1983), ch. 3: the recursive prediction error method, here for a parameter of the noise.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import dot, factor, invert, load
from satid_gym.core.jit import inline, outline
from satid_gym.core.vetting import STEP, distance

_VARIANCE = 4.0  # of e before the first reading, and at most
_RENEWAL = 0.002  # variance that e gains a second where theta does not walk
_DOUBT = 2.0
_LONGEST = 2.0  # change of e by one reading
_PAUSE = 30.0  # s between two steps: where readings go on to be beyond belief, it is not the inertia
_STEPPED = 40.0  # normalised innovation squared, of 3 degrees of freedom, that no walk explains: one in 1e8


@inline
def start(belief):
    """Before the first reading."""
    belief.walk_parameter = parameter(belief.first_walk, belief.least_walk)
    belief.most_walk_parameter = parameter(belief.most_walk, belief.least_walk)
    belief.walk_parameter_variance = _VARIANCE
    belief.steps = 0
    belief.since_step = _PAUSE
    forget(belief)


@inline
def parameter(walk, least):
    """e of a walk per sqrt(s)."""
    relative = (walk / least) ** 2
    return np.log(relative) if relative > 1.0 else relative - 1.0


@inline
def forget(belief):
    """Take theta and its covariance as they are, whatever the walk."""
    for i in range(belief.theta_slope.shape[0]):
        belief.theta_slope[i] = 0.0
        for j in range(belief.theta_slope.shape[0]):
            belief.covariance_slope[i, j] = 0.0


@outline
def predict(belief, dt):
    """Set the walk of the dt seconds to come, and what it does to the derivatives."""
    e, least = belief.walk_parameter, belief.least_walk**2
    if e >= 0.0:
        variance = slope = least * np.exp(e)
        share = 1.0
    else:
        doubt = -e * _DOUBT * np.sqrt(belief.walk_parameter_variance)
        variance, slope, share = least * max(0.0, 1.0 + e - doubt), least, (1.0 + e) ** 2
    for k in range(belief.theta_scale.shape[0]):
        scale = belief.theta_scale[k]
        belief.walk[3 + k] = np.sqrt(variance) * scale
        belief.covariance_slope[k, k] += slope * scale * scale * dt
    grown = belief.walk_parameter_variance + (share * belief.walk_drift + _RENEWAL) * dt
    belief.walk_parameter_variance = min(grown, _VARIANCE)
    belief.since_step += dt


@inline
def has_stepped(belief, work):
    """Whether the whitened reading in work says that the inertia has stepped."""
    innovation = load(work.innovation)
    if belief.since_step < _PAUSE or dot(innovation, innovation) <= _STEPPED:  # never less than the distance
        return False
    return distance(belief, work, 3 + belief.theta_scale.shape[0]) > _STEPPED


@inline
def step(belief):
    """Let the inertia have stepped."""
    forget(belief)
    belief.steps += 1
    belief.since_step = 0.0
    belief.walk_parameter_variance = _VARIANCE
    for k in range(belief.theta_scale.shape[0]):
        belief.covariance[3 + k, 3 + k] += (STEP * belief.theta_scale[k]) ** 2


@inline
def keep(belief, work):
    """Note what is known of theta before an update."""
    for i in range(belief.theta_scale.shape[0]):
        work.prior_mean[3 + i] = belief.mean[3 + i]
        for j in range(belief.theta_scale.shape[0]):
            work.prior_covariance[3 + i, 3 + j] = belief.covariance[3 + i, 3 + j]


@outline
def learn(belief, work):
    """Take in what an update has done to theta, of which `keep` noted what was known before."""
    p = belief.theta_scale.shape[0]
    inverse, taken, lost, told = work.inverse, work.taken, work.lost, work.told
    moved, solved, slope, by_walk = work.theta, work.solved, belief.covariance_slope, belief.theta_slope
    if factor(work.prior_covariance, 3, p, work.block) < 0.0:
        return  # broken, which is found elsewhere
    invert(work.block, p, inverse)
    for i in range(p):
        moved[i] = belief.mean[3 + i] - work.prior_mean[3 + i]
        for j in range(p):
            taken[i, j] = work.prior_covariance[3 + i, 3 + j] - belief.covariance[3 + i, 3 + j]
    _times(taken, inverse, lost)  # 1 - A
    _times(inverse, lost, told)  # W
    score = information = 0.0
    for i in range(p):
        solved[i] = 0.0
        for j in range(p):
            solved[i] += inverse[i, j] * moved[j]  # u
    for i in range(p):
        score += solved[i] * by_walk[i]
        for j in range(p):
            score += 0.5 * (solved[i] * solved[j] - told[i, j]) * slope[i, j]
            information += by_walk[i] * told[i, j] * by_walk[j]
    _times(told, slope, taken)
    for i in range(p):
        for j in range(p):
            information += 0.5 * taken[i, j] * taken[j, i]
    _follow(belief, work)
    variance = 1.0 / (1.0 / belief.walk_parameter_variance + max(information, 0.0))  # below 0 by rounding
    change = min(max(variance * score, -_LONGEST), _LONGEST)
    belief.walk_parameter = min(max(belief.walk_parameter + change, -1.0), belief.most_walk_parameter)
    belief.walk_parameter_variance = variance


@inline
def _follow(belief, work):
    """Derivatives after the update, with 1 - A in work.lost and u in work.solved."""
    p = belief.theta_scale.shape[0]
    slope, by_walk, lost, moved, solved = (
        belief.covariance_slope,
        belief.theta_slope,
        work.lost,
        work.theta,
        work.solved,
    )
    for i in range(p):
        moved[i] = by_walk[i]
        for j in range(p):
            moved[i] += slope[i, j] * solved[j]
    _times(lost, slope, work.taken)
    for i in range(p):
        by_walk[i] = moved[i]
        for j in range(p):
            by_walk[i] -= lost[i, j] * moved[j]
            slope[i, j] -= work.taken[i, j]  # A D
    for i in range(p):
        for j in range(i, p):
            total = slope[i, j]
            for k in range(p):
                total -= slope[i, k] * lost[j, k]
            work.taken[i, j] = work.taken[j, i] = total
    for i in range(p):
        for j in range(p):
            slope[i, j] = work.taken[i, j]


@inline
def _times(a, b, out):
    """out = a b, square matrices."""
    size = out.shape[0]
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(size):
                total += a[i, k] * b[k, j]
            out[i, j] = total
