"""Step of the inertia: found by a reading that no process noise explains, whenever it came.

When the inertia steps M stays and the rate jumps: as long as M is known, the next reading tells the new theta. Where
the body hardly turns no reading shows the step, until a faster turn does. Meanwhile M has been estimated from the rate
with the old theta: it is off by L(omega) dtheta, omega the rate of late, and where that has been changing tau has
taken up the growth of this error. A filter that keeps both then finds, when the rate has reversed, theta + dtheta in
place of theta, and believes it. With rows H_M and H_t of M and theta and S = diag(STEP scale)^2, the step may have come
unseen, before the reading that shows it, if both of these hold:

- A step at the rate omega makes the next reading jump by H_M L(omega) dtheta. Where the mean square of that is less
  than _DISTANCE, the reading does not show it. For _CONCEALED_MIN or more of the last minute that was so: then the step
  came in that time much sooner than with this reading.
- The reading is plausible if omega was known when the inertia changed: its innovation has the covariance
  H P H^T + 1 + G S G^T, G = H_t + H_M L(omega), and is within _UNSEEN_DISTANCE; while the body turns evenly G is 0. Or
  the mean of the whitened innovations before was already beyond _MEAN_SIGMAS of its standard deviations.

Then M is as likely to be known as omega was, and both are in the covariance (`inertia_change`), with tau's prior
variance added to tau's: later turns decide. Not where the inertia may vary so fast that readings which no q explains
are no steps, at the start or with a large q: M is what such an inertia is estimated from. Nor where theta is further
from the prior than _CHANGE_MAX.
Source: this project's design. Estimating when a jump came, by a filter for each instant, is due to Willsky and Jones, A
generalized likelihood ratio approach to the detection and estimation of jumps in linear systems (1976); here two
instants stand for all.
"""

from __future__ import annotations

from satid_gym.core.algebra import axpy, axpy_symmetric, dot, inverse, load, multiply, store, subtract
from satid_gym.core.belief import adaptation, gating, inertia_change
from satid_gym.core.belief.gating import STEP, distance, innovation_covariance
from satid_gym.core.belief.kalman import write_times_regressor
from satid_gym.core.jit import inline, outline

_HOLDOFF = 30.0  # s between two steps: where readings go on to be implausible, the inertia is not the cause
_DISTANCE = 40.0  # normalised innovation squared, of 3 degrees of freedom, that no q explains: one in 1e8
_SETTLING = 1.0  # s, of the running mean of the rate
_MEAN_SHARE = 0.1  # of a reading in the running mean of innovations
_MEAN_SIGMAS = 5.0
_UNSEEN_WALK_MAX = 0.01  # sqrt(q) up to which the inertia is all but constant
_MEMORY = 60.0  # s, over which it counts how long a step would have come unseen
_CONCEALED_MIN = 2.0  # s of it
_UNSEEN_DISTANCE = 9.0  # of 3 degrees of freedom: one in 30
_CHANGE_MAX = 2.0  # of theta from the prior, over its scale: no body is known as little as that
_UNSEEN = 0.5  # probability that omega was known, not M


@inline
def start(state):
    """State of an adaptation before the first reading."""
    state.steps = 0
    state.since_step = _HOLDOFF
    store(state.settled_rate, (0.0, 0.0, 0.0))
    store(state.mean_innovation, (0.0, 0.0, 0.0))
    state.conceals = state.concealed = 0.0


@inline
def follow(state, rate, dt):
    """Follow the rate (3,) that the filter has found dt seconds before its next reading, rad/s."""
    settled = load(state.settled_rate)
    store(state.settled_rate, axpy(min(1.0, dt / _SETTLING), subtract(rate, settled), settled))
    state.since_step += dt
    state.concealed += dt * (state.conceals - state.concealed / _MEMORY)


@inline
def is_shown(belief, work):
    """Whether the whitened reading in work says that the inertia has stepped."""
    innovation = load(work.innovation)
    if belief.adaptation.since_step < _HOLDOFF or dot(innovation, innovation) <= _DISTANCE:
        return False  # dot(innovation, innovation) is never less than the distance
    return distance(belief, work) > _DISTANCE


@outline
def take(belief, work, rejected):
    """Raise the covariance for the step that a reading in work shows, and count it; rejected: as the last of a run."""
    if _was_unseen(belief, work):
        inertia_change.add(belief, work, STEP, _UNSEEN)
        for k in range(3 + belief.theta_scale.shape[0], 6 + belief.theta_scale.shape[0]):
            belief.covariance[k, k] += belief.prior_torque_std**2
    elif rejected:
        gating.inflate(belief, work)
    else:
        inertia_change.add(belief, work, STEP, 0.0)
    belief.stepped = 1
    adaptation.count_step(belief.adaptation)


@inline
def _was_unseen(belief, work):
    """Whether the step that a reading in work shows may have come unseen; leaves L(omega) in work.regressor."""
    state, rows, kept, innovation = belief.adaptation, work.rows, work.regressor, load(work.innovation)
    begins = state.steps == 0 and state.since_step < 2.0 * _HOLDOFF
    if begins or state.walk > _UNSEEN_WALK_MAX or state.concealed < _CONCEALED_MIN:
        return False
    write_times_regressor(rows, load(state.settled_rate), kept)
    S = innovation_covariance(belief, work)
    for k in range(belief.theta_scale.shape[0]):
        if abs(belief.mean[3 + k] - belief.prior_theta[k]) > _CHANGE_MAX * belief.theta_scale[k]:
            return False
        x, y, z = rows[0, 3 + k] + kept[0, k], rows[1, 3 + k] + kept[1, k], rows[2, 3 + k] + kept[2, k]
        S = axpy_symmetric((STEP * belief.theta_scale[k]) ** 2, (x * x, y * y, z * z, x * y, x * z, y * z), S)
    inertia_change.write_regressor(work, load(state.settled_rate))
    mean = load(state.mean_innovation)
    grows = dot(mean, mean) > _MEAN_SIGMAS**2 * _MEAN_SHARE / (2.0 - _MEAN_SHARE)
    return grows or dot(innovation, multiply(inverse(S), innovation)) < _UNSEEN_DISTANCE


@outline
def note(belief, work):
    """Note the innovation of a whitened gyro reading in work, and whether a step at the rate of late would show."""
    state = belief.adaptation
    mean = load(state.mean_innovation)
    store(state.mean_innovation, axpy(_MEAN_SHARE, subtract(load(work.innovation), mean), mean))
    jump = work.regressor  # H_M L(omega)
    write_times_regressor(work.rows, load(state.settled_rate), jump)
    square = 0.0
    for k in range(belief.theta_scale.shape[0]):
        square += (STEP * belief.theta_scale[k]) ** 2 * (jump[0, k] ** 2 + jump[1, k] ** 2 + jump[2, k] ** 2)
    state.conceals = 1.0 if square < _DISTANCE else 0.0
