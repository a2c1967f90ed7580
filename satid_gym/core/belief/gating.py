"""Gating: validation of the readings of gyro, tachometers and star tracker before the MomentumEKF uses them.

A reading of a noisy sensor that equals the last one to the bit is repeated, not new; without noise a body at rest
repeats its readings rightly, and so may an encoder (`tachometers`). A reading of gyro or star tracker whose normalised
innovation squared is beyond the gate is rejected. The third of the gyro's in a row is accepted, for then the model is
wrong: the inertia has changed, or the reading that M was started with was an outlier. Where several aligned readings
share each outlier (`spread`) two outliers need not be enough either. In both cases the attitude begins again with the
star tracker's next reading. It also does with the third of these that is rejected in a row, of which theta is told
nothing. Where no reading of the gyro is accepted the filter coasts: it propagates only.

What a wheel does whose tachometer is stuck, `unmeasured` says. After an outage of the gyro as well nobody knows how the
body turns, so M is reinitialised when both are back. Without a gyro for a second, or without M, no reading shows a step
of the inertia: theta's covariance grows as if one came every half hour, which is an assumption.
Source of the gate: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation
(2001), ch. 5.4.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import dot, inverse, load, multiply, store
from satid_gym.core.belief import tachometers
from satid_gym.core.belief.unmeasured import is_any_stuck
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT

_OUTAGE_MAX = 10  # samples without gyro and without a tachometer after which momentum is taken as unknown
_REJECTIONS_MAX = 2  # in a row
_STEP_INTERVAL = 1800.0  # s, assumed between two steps of the inertia where none would be seen
ACCEPTED, REINITIALISE, STEPPED = 0.0, -1.0, -2.0  # what `validate` returns for a reading that is not rejected
STEP = 0.1  # std of a sudden change of each moment, relative to the prior: what a run of rejections stands for


@functools.cache
def gate_dtype(n: int) -> np.dtype:
    """Gate: its settings and state."""
    return np.dtype(
        [
            ("threshold", FLOAT),  # normalised innovation squared beyond which a reading is rejected; 0: no gate
            ("gyro_noisy", INT),  # 0: the gyro is said to have no noise
            ("spread", INT),  # aligned readings that one reading of the gyro is part of, less one
            ("torque_max", FLOAT, n),
            ("slack", FLOAT, n),  # change of wheel speed that commands may make while its reading rightly repeats
            ("suspect", FLOAT, n),  # the same, where readings of the gyro are rejected since the reading repeats
            ("rejections", INT),  # in a row
            ("since_rejection", INT),  # samples since the first of them; void without one
            ("confirmed", INT),  # 1: a reading has agreed with the one that M was started with
            ("last_gyro", FLOAT, 3),
            ("last_speed", FLOAT, n),  # of the tachometers
            ("unseen", FLOAT, n),  # change of wheel speed that commands should have made since the reading changed
            ("repeats", INT, n),  # of that reading in a row
            ("doubted", INT, n),  # 1: it is stuck if it repeats once more
            ("speed", FLOAT, n),  # as read, or of a wheel whose tachometer is stuck as it follows its command
            ("silent", INT),  # samples in a row without a reading of the gyro that was accepted
            ("outage", INT),  # samples for which neither the gyro nor a stuck tachometer gave a new reading
        ],
        align=True,
    )


@inline
def begin(belief, gyro, tachometer):
    """Accept the first reading as it is."""
    belief.gate.confirmed = 0
    store(belief.gate.last_gyro, load(gyro))
    for k in range(tachometer.shape[0]):
        belief.gate.last_speed[k] = belief.gate.speed[k] = belief.speed[k] = tachometer[k]
        belief.gate.unseen[k], belief.gate.repeats[k], belief.gate.doubted[k] = 0.0, 0, 0


@inline
def gate_tachometers(belief, tachometer, torque, dt):
    """Take in the tachometers' readings (n,), see `tachometers.take`; until a gyro reading is accepted it coasts."""
    gate = belief.gate
    gate.silent = gate.silent + 1 if belief.coasting != 0 else 0
    if tachometers.take(belief, tachometer, torque, dt):
        gate.outage += 1
    elif gate.outage <= _OUTAGE_MAX:
        gate.outage = 0
    belief.coasting = 1
    gate.since_rejection += 1


@inline
def take_momentum_loss(belief):
    """Whether M - a was unobserved for so long that nothing is known of M; once all sensors are back it ends."""
    lost = belief.gate.outage > _OUTAGE_MAX
    if not is_any_stuck(belief):
        belief.gate.outage = 0
    return lost


@inline
def doubt_inertia(belief, dt):
    """Add to theta's covariance the steps that may have come in dt seconds for which no reading shows them."""
    if max(belief.gate.silent, belief.gate.outage) > _OUTAGE_MAX:
        for k in range(belief.theta_scale.shape[0]):
            belief.covariance[3 + k, 3 + k] += (STEP * belief.theta_scale[k]) ** 2 * dt / _STEP_INTERVAL


@inline
def note_repeat(belief, gyro):
    """Note a gyro reading; whether it repeats the last one, which is counted. Never where the gyro has no noise."""
    repeated = belief.gate.gyro_noisy != 0
    for i in range(3):
        repeated = repeated and gyro[i] == belief.gate.last_gyro[i]
        belief.gate.last_gyro[i] = gyro[i]
    if repeated:
        belief.rejected += 1
    return repeated


@outline
def innovation_covariance(belief, work):
    """S = H P H^T + 1 (symmetric) of the whitened reading in work.rows."""
    rows, covariance, ph, size = work.rows, belief.covariance, work.ph, belief.mean.shape[0]
    s = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    for i in range(3):
        for a in range(size):
            ph[a] = 0.0
            for b in range(size):
                ph[a] += covariance[a, b] * rows[i, b]
        x = y = z = 0.0
        for a in range(size):
            x += rows[0, a] * ph[a]
            y += rows[1, a] * ph[a]
            z += rows[2, a] * ph[a]
        if i == 0:
            s = (s[0] + x, s[1], s[2], y, z, s[5])
        elif i == 1:
            s = (s[0], s[1] + y, s[2], s[3], s[4], z)
        else:
            s = (s[0], s[1], s[2] + z, s[3], s[4], s[5])
    return s


@inline
def distance(belief, work):
    """Normalised innovation squared of the whitened reading in work.rows and work.innovation."""
    innovation = load(work.innovation)
    return dot(innovation, multiply(inverse(innovation_covariance(belief, work)), innovation))


@inline
def validate(belief, work):
    """Normalised innovation squared of a reading that is rejected; else ACCEPTED, REINITIALISE or STEPPED.

    After a run of rejections the inertia may have stepped (STEPPED: inflate the covariance and accept the reading), or
    the one reading that M was started with was an outlier (REINITIALISE).
    """
    innovation = load(work.innovation)
    nis = 0.0
    if dot(innovation, innovation) > belief.gate.threshold:  # never less than the distance
        nis = distance(belief, work)
    if nis <= belief.gate.threshold:
        belief.gate.rejections = 0
        return ACCEPTED
    if belief.gate.rejections == 0:
        belief.gate.since_rejection = 1  # the change came at the beginning of this sample
    belief.gate.rejections += 1
    if belief.gate.rejections > _REJECTIONS_MAX * (1 + belief.gate.spread):
        if belief.gate.confirmed == 0:
            return REINITIALISE
        belief.gate.rejections = 0
        if tachometers.doubt_repeats(belief):
            belief.rejected += 1
            return nis
        return STEPPED
    belief.rejected += 1
    return nis


@outline
def note_repeated_attitude(belief, reading):
    """Note a reading (4,) of the star tracker; whether it repeats the last one to the bit, which is counted."""
    state = belief.attitude
    repeated = state.noisy != 0
    for i in range(4):
        repeated = repeated and reading[i] == state.last[i]
        state.last[i] = reading[i]
    if repeated:
        belief.rejected += 1
    return repeated


@outline
def validate_attitude(belief, work):
    """Normalised innovation squared of a reading of the star tracker that is rejected; else ACCEPTED or REINITIALISE.

    After a run of rejections the attitude itself, or the reading that it began with, is wrong: it begins again.
    """
    state, nis = belief.attitude, distance(belief, work)
    if nis <= belief.gate.threshold:
        state.rejections = 0
        return ACCEPTED
    state.rejections += 1
    if state.rejections > _REJECTIONS_MAX:
        return REINITIALISE
    belief.rejected += 1
    return nis


@outline
def inflate(belief, work):
    """Add to the covariance a change of theta that came with the first rejection and has moved M since."""
    belief.stepped = 1
    substeps = belief.substeps if belief.modes.coupling.shape[0] == 0 else 1  # work.transition: of one, or of them all
    covariance, steps = belief.covariance, belief.gate.since_rejection * substeps
    for k in range(belief.theta_scale.shape[0]):
        variance = (STEP * belief.theta_scale[k]) ** 2
        covariance[3 + k, 3 + k] += variance
        for i in range(3):
            moved = steps * work.transition[i, 3 + k]
            covariance[i, 3 + k] += moved * variance
            covariance[3 + k, i] += moved * variance
            for j in range(i, 3):
                change = moved * variance * steps * work.transition[j, 3 + k]
                covariance[i, j] = covariance[j, i] = covariance[i, j] + change
