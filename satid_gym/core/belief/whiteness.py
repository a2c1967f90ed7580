"""Whiteness: the innovations of the MomentumEKF, watched for what its model leaves out.

A consistent filter's normalised innovations e (3) are white with unit variance. What is not modelled, as a panel's
ringing or slosh, makes them larger, or alike from one reading to the next (coloured). For time constants of T samples

    y += (1 - a) (e - y),   a = exp(-1 / T);   R = mean of y^2 (1 + a) / (1 - a)

R is the variance of e in the long run, sum over k of a^|k| E[e(t) e(t - k)], over that of white ones: 1 where nothing
is left out. T = 0 gives the mean NIS, by axis. Means are over the last MEMORY readings and begin with PRIOR readings
as expected. An R beyond its limit is an alarm; the limits are quantiles of white noise's own largest R, for the two
shortest T raised by hand. An inertia that varies and is followed with a lag colours innovations slowly too, so beyond
the _FAST shortest T an R counts only while the filter's own walk says that the inertia hardly varies, or, with
`inflate`, once another R has gone beyond its limit.

With `inflate` the readings' noise covariance is multiplied by F, the square of the largest R / limit beyond 1: what is
left out is no noise that averages out, but comes with the motion that tells of the inertia. Where F has grown by g > 1
over its largest so far, what was learned before was learned from the same readings, and counts as much less:

    (P+)^-1 = P^-1 / g + (1 - 1 / g) S^-1

with S diagonal: the prior variances of theta, of the disturbance torque, of the modes' frequency, size and damping and
of the errors of sensors and wheels, each at least the variance it has; infinite for M, the attitude's error and the
modes' motion, which the next readings tell again. So each state grows by itself, at most to its prior.

Where modes are estimated, an early alarm comes from a frequency, coupling or inertia that was known too poorly for the
linearisation to hold, not from what is left out. So within _EARLY readings the filter restarts from its mean: g is
_RESTART_GROWTH times the square of the excess, F stays 1, and y and R start again. That happens at most RESTARTS_MAX
times. A mode's estimate far from its data sheet says the same, though innovations need not: the filter then restarts
from the data sheet, with a g that leaves nothing of what readings have told.

F falls with R, and is watched for that however little is known meanwhile. A filter with a large F follows slowly, which
colours its innovations too: where little excites the body, or the inertia varies, F may stay large by itself.
Source: Mehra, On the identification of variances and adaptive Kalman filtering (1970), for the test; Newey and West,
A simple positive semi-definite heteroskedasticity and autocorrelation consistent covariance matrix (1987), for the
variance in the long run. Factor and restarts are this project's.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT

TIME_CONSTANTS = (0.0, 3.0, 10.0, 30.0, 100.0)  # T, samples
# of R: the last three within 3 % of what baselines/tuning/whiteness_limits.py prints; the first two were raised by hand
# from 1.30 and 1.65, for the alarms of flights with a periodic inertia on tuning seeds, of which no command is kept
LIMITS = (1.4, 1.9, 2.28, 3.42, 4.89)
FALSE_ALARM_RATE = 0.01  # share of white flights of 3000 readings that go beyond a limit, at most
MEMORY, PRIOR = 1000, 100  # readings
_KEPT = tuple(float(np.exp(-1.0 / T)) if T > 0.0 else 0.0 for T in TIME_CONSTANTS)  # a
_FAST = 2  # the first time constants, too short for a varying inertia to colour innovations
_FACTOR_MAX = 1e4
# of restarts: chosen by hand among five versions, by 200 tuning flights in scenario flex and by three worlds of
# baselines.studies.consistency on validation seeds; docs/flexible.md has test seeds
_EARLY = 300  # readings since y and R started
_RESTART_GROWTH = 4.0
_AFRESH = 1e4  # growth that leaves nothing of what readings have told
RESTARTS_MAX = 4
_STILL = 5e-4  # walk of the inertia, per sqrt(s), below which it hardly varies: chosen by hand for the same
_COUNT = len(TIME_CONSTANTS)


@functools.cache
def whiteness_dtype() -> np.dtype:
    """Whiteness: its setting and state; as of white innovations where nothing is watched."""
    return np.dtype(
        [
            ("inflate", INT),  # 1: an alarm inflates, or restarts
            ("readings", INT),  # that were watched
            ("smoothed", FLOAT, (_COUNT, 3)),  # y
            ("kept", FLOAT, _COUNT),  # a^(2 readings): share of y's variance that is yet to come
            ("variance", FLOAT, (_COUNT, 3)),  # R
            ("restarts", INT),  # so far
            ("factor", FLOAT),  # F; 1 without alarm, and without `inflate`
            ("factor_max", FLOAT),  # largest so far
        ],
        align=True,
    )


@inline
def start(belief):
    """Write the state before the first reading."""
    state = belief.whiteness
    state.restarts = 0
    state.factor = state.factor_max = 1.0
    _begin(state)


@inline
def _begin(state):
    """Start y and R as if everything had been as expected."""
    state.readings = 0
    for k in range(_COUNT):
        state.kept[k] = 1.0
        for i in range(3):
            state.smoothed[k, i] = 0.0
            state.variance[k, i] = 1.0


@inline
def is_inflated(belief):
    """Whether F is above 1; then each reading is watched, however little is known, so that F falls again."""
    return belief.whiteness.factor > 1.0


@outline
def note(belief, work):
    """Take in the innovation of the update that was just made, and inflate what that calls for."""
    state = belief.whiteness
    state.readings += 1
    weight = 1.0 / min(state.readings + PRIOR, MEMORY)
    if state.factor != 1.0:  # the reading was whitened with it: normalise the innovation as if without
        for i in range(3):
            variance = work.innovation_variance[i]
            work.normalised[i] *= np.sqrt(state.factor * variance / (1.0 + state.factor * (variance - 1.0)))
    for k in range(_COUNT):
        a = _KEPT[k]
        state.kept[k] *= a * a
        scale = (1.0 + a) / ((1.0 - a) * (1.0 - state.kept[k]))
        for i in range(3):
            y = state.smoothed[k, i] + (1.0 - a) * (work.normalised[i] - state.smoothed[k, i])
            state.smoothed[k, i] = y
            state.variance[k, i] += weight * (scale * y * y - state.variance[k, i])
    if state.inflate != 0:
        _inflate(belief)


@inline
def inertia_walk(belief):
    """Random walk of each moment over its scale that the filter uses, per sqrt(s)."""
    adapts = belief.adaptation.on != 0
    return belief.adaptation.walk if adapts else belief.walk[3] / belief.theta_scale[0]


@inline
def excess(state, k):
    """R over its limit for time constant k, the largest of the three axes."""
    R = state.variance
    return max(R[k, 0], R[k, 1], R[k, 2]) / LIMITS[k]


@inline
def mean_nis(state):
    """Mean normalised innovation squared per degree of freedom."""
    return (state.variance[0, 0] + state.variance[0, 1] + state.variance[0, 2]) / 3.0


@inline
def _counted(state, walk):
    """How many time constants count for a filter whose inertia walks so, per sqrt(s)."""
    return _COUNT if walk <= _STILL or state.factor_max > 1.0 else _FAST


@inline
def colour(state, walk):
    """R over its limit, the largest of those that count but the mean NIS."""
    largest = 0.0
    for k in range(1, _counted(state, walk)):
        largest = max(largest, excess(state, k))
    return largest


@inline
def is_alarmed(state, walk):
    """Whether innovations are larger, or more coloured, than those of white flights."""
    return excess(state, 0) > 1.0 or colour(state, walk) > 1.0


@inline
def _inflate(belief):
    """Set F by the innovations, or restart; raise the covariance where F is the largest so far.

    That F is the square of the excess, not the excess itself, was chosen by hand.
    """
    state = belief.whiteness
    beyond = max(1.0, excess(state, 0), colour(state, inertia_walk(belief)))
    if _may_restart(belief):
        if beyond > 1.0:
            _forget(belief, _RESTART_GROWTH * beyond * beyond)
            _begin(state)
            state.restarts += 1
        return
    state.factor = factor = min(beyond * beyond, _FACTOR_MAX)
    if factor <= state.factor_max:
        return
    _forget(belief, factor / state.factor_max)
    state.factor_max = factor


@inline
def _may_restart(belief):
    """Whether an alarm now is answered by a restart."""
    state = belief.whiteness
    early = state.readings <= _EARLY and state.restarts < RESTARTS_MAX and state.factor_max == 1.0
    return early and belief.modes.std.shape[0] > 0


@inline
def may_begin_again(state):
    """Whether there may be another restart."""
    return state.inflate != 0 and state.restarts < RESTARTS_MAX


@inline
def begin_again(belief):
    """Restart from the mean with what is known without any reading."""
    _forget(belief, _AFRESH)
    _begin(belief.whiteness)
    belief.whiteness.restarts += 1


@inline
def _forget(belief, growth):
    """Divide what the readings have told by `growth` > 1, and keep what was known before the first of them."""
    p, modes, errors = belief.prior_theta.shape[0], belief.modes, belief.calibration
    size, calibrated = belief.mean.shape[0], errors.prior_covariance.shape[0]
    for i in range(size):
        for j in range(size):
            belief.covariance[i, j] *= growth
    for k in range(p):
        _keep_prior(belief, 3 + k, belief.prior_theta_std[k] ** 2, growth)
    for i in range(3):
        _keep_prior(belief, 3 + p + i, belief.prior_torque_std**2, growth)
    for i in range(modes.std.shape[0]):
        for k in range(2, modes.std.shape[1]):  # frequency, size and damping; deflection and momentum have no prior
            _keep_prior(belief, modes.first + modes.std.shape[1] * i + k, modes.std[i, k] ** 2, growth)
    for k in range(calibrated):
        _keep_prior(belief, size - calibrated + k, errors.prior_covariance[k, k], growth)


@inline
def _keep_prior(belief, k, variance, growth):
    """Add 1 - 1 / growth of the information that state k's prior variance stands for, as if it were measured."""
    P = belief.covariance
    if P[k, k] <= 0.0:
        return
    variance = max(variance, P[k, k] / growth)  # where the state has moved, its prior is no longer known
    total = variance * growth / (growth - 1.0) + P[k, k]
    for i in range(P.shape[0]):
        if i != k:
            for j in range(i, P.shape[0]):
                if j != k:
                    P[i, j] = P[j, i] = P[i, j] - P[i, k] * P[k, j] / total
    share = 1.0 - P[k, k] / total
    for i in range(P.shape[0]):
        P[i, k] = P[k, i] = share * P[i, k]
