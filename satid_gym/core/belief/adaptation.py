"""Adaptation: process noise of the inertia, estimated together with theta by recursive maximum likelihood.

theta is a random walk of variance q a second, relative to its scale; of six parameters mostly along theta itself,
0.9 theta theta^T + 0.1 diag(scale)^2, for a reading tells of three combinations alone, and an inertia that varies does
so as a whole sooner than in shape. An update that moves theta's mean by d and takes
its covariance from P- to P+ tells what a measurement of theta alone would; the derivative of that measurement's
log-likelihood by a parameter e of q, and the information on e, are

    score = u.t + (u^T D u - tr W D) / 2,   information = t^T W t + tr (W D)^2 / 2
    u = (P-)^-1 d,   W = (P-)^-1 - (P-)^-1 P+ (P-)^-1,   t = d theta / de,   D = dP / de before the update

and with A = P+ (P-)^-1 the update takes t to A (t + D u), D to A D A^T. (That M's error is theta's as well is left
out.) With q_min the least variance that matters

    q / q_min = exp(e) for e >= 0,   1 + e for -1 <= e < 0

so that q may also be 0; so that the estimate's noise is not taken for process noise, the filter uses 1 + e less -e
times _DOUBT_SIGMAS standard deviations of e. e is a random walk itself: its variance falls with the information and
grows with time. Where no reading tells of theta its variance grows faster than q says (`coherence`). An innovation
that no q explains is a step of the inertia (`inertia_step`).
Source: Mehra, Approaches to adaptive filtering (1972); Ljung and Soderstrom, Theory and practice of recursive
identification (1983), ch. 3: the recursive prediction error method, here for a parameter of the noise.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import load_symmetric, store_symmetric
from satid_gym.core.belief import coherence
from satid_gym.core.belief.kalman import multiply_rows
from satid_gym.core.factors import factor, factored_inverse, invert
from satid_gym.core.jit import inline, outline, outline_disjoint
from satid_gym.core.records import FLOAT, INT

_LOG_Q_VARIANCE = 4.0  # of e before the first reading, and at most
_LOG_Q_NOISE = 0.002  # variance that e gains a second where theta does not vary
_LOG_Q_CHANGE_MAX = 2.0  # change of e by one reading
_DOUBT_SIGMAS = 2.0
_OWN_SHARE = 0.1  # of the walk of six parameters, that each has of its own; the rest is that of a common factor


@functools.cache
def adaptation_dtype(p: int) -> np.dtype:
    """Adaptation: its settings and state; void where `on` is 0."""
    return np.dtype(
        [
            ("on", INT),
            ("inertia_walk", FLOAT),  # first sqrt(q), per sqrt(s)
            ("inertia_walk_min", FLOAT),  # sqrt(q_min)
            ("inertia_walk_max", FLOAT),
            ("log_q_drift", FLOAT),  # variance that e gains a second
            ("log_q", FLOAT),  # e
            ("log_q_max", FLOAT),
            ("log_q_variance", FLOAT),
            ("theta_slope", FLOAT, p),  # t
            ("covariance_slope", FLOAT, (p, p)),  # D
            ("walk", FLOAT),  # sqrt(q) of the last prediction
            ("steps", INT),  # of the inertia that were found, see `inertia_step`
            ("since_step", FLOAT),  # s
            ("settled_rate", FLOAT, 3),  # running mean of the rate, rad/s
            ("conceals", FLOAT),  # 1 where no reading would show a step, else 0
            ("concealed", FLOAT),  # s of the last minute in which that was so
            ("mean_innovation", FLOAT, 3),  # running mean of the gyro's whitened innovations
            ("age", FLOAT),  # s, T and T_u of `coherence`
            ("usual_age", FLOAT),
        ],
        align=True,
    )


@functools.cache
def adaptation_work_dtype(p: int) -> np.dtype:
    """Scratch space: theta and P before an update, and what the update did."""
    return np.dtype(
        [
            ("theta", FLOAT, p),
            ("P", FLOAT, (p, p)),
            ("P_inv", FLOAT, (p, p)),
            ("d", FLOAT, p),
            ("P_inv_d", FLOAT, p),  # u
            ("dP", FLOAT, (p, p)),
            ("I_minus_A", FLOAT, (p, p)),
            ("information_gain", FLOAT, (p, p)),  # W
        ],
        align=True,
    )


@inline
def start(belief):
    """State before the first reading."""
    state = belief.adaptation
    state.log_q = _log_q(state.inertia_walk, state.inertia_walk_min)
    state.log_q_max = _log_q(state.inertia_walk_max, state.inertia_walk_min)
    state.log_q_variance = _LOG_Q_VARIANCE
    state.walk = state.inertia_walk
    coherence.start(state)
    forget(state)


@inline
def _log_q(walk, walk_min):
    """e of a random walk per sqrt(s)."""
    relative = (walk / walk_min) ** 2
    return np.log(relative) if relative > 1.0 else relative - 1.0


@inline
def forget(state):
    """Take theta and its covariance as they are, whatever q."""
    coherence.forget(state)
    for i in range(state.theta_slope.shape[0]):
        state.theta_slope[i] = 0.0
        for j in range(state.theta_slope.shape[0]):
            state.covariance_slope[i, j] = 0.0


@outline
def predict(belief, dt):
    """Set the process noise of the dt seconds to come, and what it does to the derivatives."""
    state, D, P = belief.adaptation, belief.adaptation.covariance_slope, belief.covariance
    e, q_min, doubt = state.log_q, state.inertia_walk_min**2, _DOUBT_SIGMAS * np.sqrt(state.log_q_variance)
    if e >= 0.0:
        variance = slope = q_min * np.exp(e)
        share = 1.0
    else:
        variance, slope, share = q_min * max(0.0, 1.0 + e + e * doubt), q_min, (1.0 + e) ** 2
    state.walk = np.sqrt(variance)
    faster = coherence.predict(state, dt, min(max(e - doubt, 0.0), 1.0))
    variance, slope = faster * variance, faster * slope
    p = belief.theta_scale.shape[0]
    own = _OWN_SHARE if p == 6 else 1.0
    for k in range(p):
        scale = belief.theta_scale[k]
        belief.walk[3 + k] = np.sqrt(own * variance) * scale
        state.covariance_slope[k, k] += own * slope * scale * scale * dt
        for j in range(k, p if own < 1.0 else 0):  # both entries in one statement: rounding depends on the order
            common = (1.0 - own) * belief.mean[3 + k] * belief.mean[3 + j] * dt
            D[k, j] = D[j, k] = D[k, j] + slope * common
            P[3 + k, 3 + j] = P[3 + j, 3 + k] = P[3 + k, 3 + j] + variance * common
    grown = state.log_q_variance + (share * state.log_q_drift + _LOG_Q_NOISE) * dt
    state.log_q_variance = min(grown, _LOG_Q_VARIANCE)


@inline
def count_step(state):
    """Count a step of the inertia, and begin to estimate q again."""
    forget(state)
    state.steps += 1
    state.since_step = 0.0
    state.log_q_variance = _LOG_Q_VARIANCE


@inline
def keep(belief, work):
    """Keep theta and its covariance before an update, for `learn`."""
    kept = work.adaptation
    for i in range(belief.theta_scale.shape[0]):
        kept.theta[i] = belief.mean[3 + i]
        for j in range(belief.theta_scale.shape[0]):
            kept.P[i, j] = belief.covariance[3 + i, 3 + j]


@outline_disjoint
def learn(belief, work):
    """Update e and its derivatives by what an update has done to theta since `keep`."""
    p = belief.theta_scale.shape[0]
    state, w = belief.adaptation, work.adaptation
    t, D, u, W = state.theta_slope, state.covariance_slope, w.P_inv_d, w.information_gain
    if not _invert(w.P, work.block, w.P_inv):
        return  # broken, which `reward.dispersion` finds
    for i in range(p):
        w.d[i] = belief.mean[3 + i] - w.theta[i]
        for j in range(p):
            w.dP[i, j] = w.P[i, j] - belief.covariance[3 + i, 3 + j]
    multiply_rows(w.dP, w.P_inv, w.I_minus_A, p)
    multiply_rows(w.P_inv, w.I_minus_A, W, p)
    score = information = 0.0
    for i in range(p):
        u[i] = 0.0
        for j in range(p):
            u[i] += w.P_inv[i, j] * w.d[j]
    for i in range(p):
        score += u[i] * t[i]
        for j in range(p):
            score += 0.5 * (u[i] * u[j] - W[i, j]) * D[i, j]
            information += t[i] * W[i, j] * t[j]
    multiply_rows(W, D, w.dP, p)
    for i in range(p):
        for j in range(p):
            information += 0.5 * w.dP[i, j] * w.dP[j, i]
    coherence.learn(state, w.I_minus_A)
    _update_slopes(state, w)
    variance = 1.0 / (1.0 / state.log_q_variance + max(information, 0.0))  # below 0 by rounding
    change = min(max(variance * score, -_LOG_Q_CHANGE_MAX), _LOG_Q_CHANGE_MAX)
    state.log_q = min(max(state.log_q + change, -1.0), state.log_q_max)
    state.log_q_variance = variance


@inline
def _invert(P, block, out):
    """out = P^-1, and whether P is positive definite; `block` is scratch space."""
    if P.shape[0] == 3:
        inverted, least = factored_inverse(load_symmetric(P))
        store_symmetric(out, inverted)
        return least > 0.0
    if factor(P, 0, P.shape[0], block) < 0.0:
        return False
    invert(block, P.shape[0], out)
    return True


@inline
def _update_slopes(state, w):
    """t and D after the update: A (t + D u) and A D A^T."""
    p = state.theta_slope.shape[0]
    t, D, I_minus_A, d, product = state.theta_slope, state.covariance_slope, w.I_minus_A, w.d, w.dP
    for i in range(p):
        d[i] = t[i]
        for j in range(p):
            d[i] += D[i, j] * w.P_inv_d[j]
    multiply_rows(I_minus_A, D, product, p)
    for i in range(p):
        t[i] = d[i]
        for j in range(p):
            t[i] -= I_minus_A[i, j] * d[j]
            D[i, j] -= product[i, j]  # A D
    for i in range(p):
        for j in range(i, p):
            total = D[i, j]
            for k in range(p):
                total -= D[i, k] * I_minus_A[j, k]
            product[i, j] = product[j, i] = total
    for i in range(p):
        for j in range(p):
            D[i, j] = product[i, j]
