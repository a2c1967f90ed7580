"""Updates of the MomentumEKF by a reading: in errors of the momentum or of the rate, once or iterated."""

from __future__ import annotations

from satid_gym.core.algebra import axpy, dot, inverse, load, multiply
from satid_gym.core.belief import (
    adaptation,
    alignment,
    attitude,
    calibration,
    gating,
    inertia_step,
    modes,
    momentum_model,
    retraction,
    star_reading,
    unmeasured,
    whiteness,
)
from satid_gym.core.belief.gating import STEP, innovation_covariance
from satid_gym.core.belief.kalman import is_known_to, update
from satid_gym.core.jit import inline, outline

_ITERATE_ABOVE = 0.05  # relative std of a moment above which updates are iterated
_ITERATIONS = 4
_STEP_OVER = 0.01  # relative std of the moments at which a step of the inertia counts as learned


@outline
def update_gyro(belief, work, gyro):
    """Update by the reading, which is linearised about the mean in work."""
    if belief.adaptation.on != 0 and not is_coarse(belief):
        if inertia_step.is_shown(belief, work):
            inertia_step.take(belief, work, False)
            attitude.doubt(belief, work, STEP)
            if alignment.leave_out_mixed(belief):
                return 0.0
        inertia_step.note(belief, work)
    if belief.stepped != 0 and is_known_to(belief, _STEP_OVER):
        belief.stepped = 0
    coarse = is_coarse(belief)
    if belief.rate_coordinates != 0 and belief.stepped == 0 and not (coarse and _is_nonlinear(belief, work)):
        nis = _update_rate(belief, work)
        if not coarse or whiteness.is_inflated(belief):
            whiteness.note(belief, work)
        return nis
    if not coarse:
        nis = _update_once(belief, work)
        whiteness.note(belief, work)
        return nis
    if belief.adaptation.on != 0:
        adaptation.forget(belief.adaptation)
    size, prior_mean, prior = belief.mean.shape[0], work.prior_mean, work.prior_covariance
    _copy(belief.mean, belief.covariance, prior_mean, prior, size)
    nis, constrained_updates = 0.0, belief.constrained_updates
    for iteration in range(_ITERATIONS):
        if iteration > 0:
            modes.refresh(belief)
            momentum_model.linearise(belief, work, gyro)
        for r in range(3):
            for k in range(size):
                work.innovation[r] -= work.rows[r, k] * (prior_mean[k] - belief.mean[k])
        _copy(prior_mean, prior, belief.mean, belief.covariance, size)
        nis = update(belief, work, 3)
    belief.constrained_updates = min(belief.constrained_updates, constrained_updates + 1)
    calibration.take_up(belief)
    if whiteness.is_inflated(belief):
        whiteness.note(belief, work)
    return nis


@inline
def _is_nonlinear(belief, work):
    """Whether one linear update by what is in work leaves a moment with an error beyond the std that it leaves.

    A predicted rate is inversely proportional to a moment: an update that changes it by the share s is off by s^2.
    """
    S_inv = inverse(innovation_covariance(belief, work))
    found = False
    for k in range(3):
        column = (0.0, 0.0, 0.0)  # of H P
        for j in range(belief.mean.shape[0]):
            column = axpy(belief.covariance[3 + k, j], (work.rows[0, j], work.rows[1, j], work.rows[2, j]), column)
        gain = multiply(S_inv, column)
        error = dot(gain, load(work.innovation)) ** 2 / belief.mean[3 + k]
        found = found or error * error > belief.covariance[3 + k, 3 + k] - dot(gain, column)
    return found


@inline
def _update_once(belief, work):
    """Update by what is in work, in errors of the momentum."""
    if belief.adaptation.on != 0:
        adaptation.keep(belief, work)
    nis = update(belief, work, 3)
    if belief.adaptation.on != 0:
        adaptation.learn(belief, work)
    calibration.take_up(belief)
    return nis


@inline
def _update_rate(belief, work):
    """Update by what is in work, in errors of the rate.

    Not where one linearisation will not do, which an iteration in M replaces. Nor after a step of the inertia: that
    changes the rate and leaves M, so what is known there is M.
    """
    coarse, adapts = is_coarse(belief), belief.adaptation.on != 0
    if adapts and coarse:
        adaptation.forget(belief.adaptation)
        adapts = False
    if adapts:
        adaptation.keep(belief, work)
    retraction.begin(belief, work)
    nis = update(belief, work, 3)
    if adapts:
        adaptation.learn(belief, work)
    retraction.finish(belief, work)
    return nis


@inline
def is_coarse(belief):
    """Whether a moment is known to no better than 5 %."""
    return not is_known_to(belief, _ITERATE_ABOVE)


@inline
def _copy(mean, covariance, to_mean, to_covariance, size):
    for i in range(size):
        to_mean[i] = mean[i]
        for j in range(size):
            to_covariance[i, j] = covariance[i, j]


@outline
def update_attitude(belief, work, reading):
    """Update by a reading (4,) of the star tracker; normalised innovation squared (3), 0 where nothing was compared.

    After a step updates by the gyro are iterated while a moment is known to no better than 5 %: the attitude begins
    again with each reading. With a gate a run of rejections is no step, which the gyro shows.
    """
    gated = belief.gate.threshold > 0.0
    if gated and gating.note_repeated_attitude(belief, reading):
        return 0.0
    iterated = is_coarse(belief) and belief.stepped != 0
    if iterated or not attitude.is_known(belief):
        star_reading.begin(belief, work, reading)
        return 0.0
    if belief.coasting != 0:
        momentum_model.follow_own_rate(belief, momentum_model.inverse_inertia(belief))
    star_reading.linearise(belief, work, reading)
    if gated:
        decision = gating.validate_attitude(belief, work)
        if decision > 0.0:
            return decision
        if decision == gating.REINITIALISE:
            star_reading.begin(belief, work, reading)
            return 0.0
    elif belief.adaptation.on != 0 and not is_coarse(belief) and inertia_step.is_shown(belief, work):
        inertia_step.take(belief, work, False)
        attitude.doubt(belief, work, STEP)
        alignment.leave_out_mixed(belief)
        star_reading.begin(belief, work, reading)
        return 0.0
    belief.attitude.age, before = belief.attitude.wait * belief.attitude.period, load(belief.mean)
    nis = _update_once(belief, work) if belief.stepped != 0 else _update_rate(belief, work)
    attitude.take_up(belief)
    if belief.modes.coupling.shape[0] > 0:
        modes.refresh(belief)
    if gated:
        unmeasured.follow(belief, before)
    return nis
