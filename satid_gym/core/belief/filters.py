"""Filters by kind: what an episode asks of a filter, handed to the module of the filter that flies.

A new filter is a module with these functions, a member of `FilterKind` and a branch in each function here.
"""

from __future__ import annotations

from enum import IntEnum

from satid_gym.core.algebra import load
from satid_gym.core.belief import (
    alignment,
    calibration,
    gating,
    modes,
    momentum_filter,
    momentum_start,
    momentum_update,
    rate_filter,
    star_reading,
    whiteness,
)
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import ObservationForm


class FilterKind(IntEnum):
    """Filter of a belief record."""

    MOMENTUM, RATE = range(2)


_MOMENTUM = int(FilterKind.MOMENTUM)
_BODY = int(ObservationForm.BODY)


@inline
def start(belief, work, gyro, tachometer):
    """Belief after the first reading."""
    if belief.kind == _MOMENTUM:
        momentum_start.start(belief, work, gyro, tachometer)
    else:
        rate_filter.start(belief, work, gyro, tachometer)


@inline
def predict(belief, work, tachometer, dt):
    """Move the belief on to the present reading of the tachometers."""
    if belief.kind == _MOMENTUM:
        momentum_filter.predict(belief, work, tachometer, dt)
    else:
        rate_filter.predict(belief, work, tachometer, dt)


@inline
def condition(belief, work, gyro, tachometer):
    """Update the belief with the present readings; normalised innovation squared per degree of freedom."""
    if belief.gate.threshold == 0.0:
        belief.coasting = 0
    if belief.kind == _MOMENTUM:
        nis, fresh = 0.0, 1
        if belief.gate.threshold > 0.0 and gating.note_repeat(belief, gyro):
            fresh = 0
        if alignment.take_gyro(belief, gyro, fresh):
            nis = momentum_filter.condition(belief, work, gyro) / 3.0
        _take_what_waited(belief, work)
        return nis
    return rate_filter.condition(belief, work, gyro, tachometer) / (3.0 + tachometer.shape[0])


@inline
def condition_wheels(belief, work, tachometer):
    """Update the belief with the tachometers alone; normalised innovation squared per degree of freedom.

    Without gyro the MomentumEKF has nothing to update: the tachometers are its prediction's input.
    """
    belief.coasting = 1
    if belief.kind == _MOMENTUM:
        alignment.take_gyro(belief, belief.reference_rate, 0)
        _take_what_waited(belief, work)
        return 0.0
    return rate_filter.condition_wheels(belief, work, tachometer) / tachometer.shape[0]


@outline
def _take_what_waited(belief, work):
    """Update by a reading of the star tracker that has waited for this sample's state."""
    state = belief.attitude
    if state.boresight.shape[0] == 0:
        return
    if state.wait > 0:  # noqa: SIM102, a constant in C, where without it there is nothing to index
        if state.waits[state.wait] != 0:
            state.waits[state.wait] = 0
            momentum_update.update_attitude(belief, work, state.line[state.wait])


@inline
def condition_attitude(belief, work, reading):
    """Update the belief with a reading (4,) of the star tracker; normalised innovation squared per degree of freedom.

    0 where nothing was compared, or will be later, with readings that are late or averaged.
    """
    if belief.attitude.boresight.shape[0] == 0 or star_reading.await_state(belief, reading):
        return 0.0
    return momentum_update.update_attitude(belief, work, reading) / 3.0


@inline
def rate(belief):
    """Estimated omega, rad/s."""
    return momentum_filter.rate(belief) if belief.kind == _MOMENTUM else rate_filter.rate(belief)


@inline
def rate_used(belief, gyro):
    """The gyro's reading, less its estimated errors, or, where the filter coasts, the filter's own rate, rad/s.

    Brought to the present, where the reading is that of an earlier instant.
    """
    if belief.coasting != 0:
        return alignment.present_rate(belief, rate(belief), belief.alignment.state_age)
    reading = load(gyro) if belief.calibration.prior_covariance.shape[0] == 0 else calibration.corrected(belief, gyro)
    return alignment.present_rate(belief, reading, belief.alignment.age)


@inline
def wheel_speed_used(belief, tachometer, k):
    """Reading of wheel k's tachometer, rad/s, or the filter's own speed where that is stuck."""
    return tachometer[k] if belief.stuck[k] == 0 else belief.gate.speed[k]


@inline
def momentum_and_torque(belief):
    """Estimated total momentum, N m s, and disturbance torque, N m; the RateEKF knows no torque."""
    if belief.kind == _MOMENTUM:
        return momentum_filter.momentum(belief), momentum_filter.disturbance(belief)
    return rate_filter.momentum(belief), (0.0, 0.0, 0.0)


@inline
def state_scale(belief, task, i):
    """Scale of state i, which is no inertia parameter: what the envelope allows, the prior for what it leaves open.

    Errors and modes have the torque's in the form WHEELS, in which policies were published before there were any.
    """
    p = belief.prior_theta.shape[0]
    if belief.kind == _MOMENTUM:
        if i < 3:
            return belief.theta_scale[i] * task.rate_limit
        psi = i - belief.attitude.first
        if belief.attitude.boresight.shape[0] > 0 and psi >= 0 and psi < 3:
            return 1.0
        if i < 6 + p or task.observation != _BODY:
            return belief.prior_torque_std
        error = i - (belief.mean.shape[0] - belief.calibration.prior_covariance.shape[0])
        if error >= 0:
            return belief.calibration.prior_covariance[error, error] ** 0.5
        return modes.state_scale(belief, task.rate_limit, i - belief.modes.first)
    return task.rate_limit if i < 3 else task.wheel_speed_max[i - 3 - p]


@inline
def tell(belief, report):
    """Write what the filter says of itself, apart from its estimate, to a report."""
    state, walk = belief.whiteness, whiteness.inertia_walk(belief)
    report.nis_mean, report.colour = whiteness.mean_nis(state), whiteness.colour(state, walk)
    alarmed = whiteness.is_alarmed(state, walk) or modes.have_left_data_sheet(belief)
    report.unmodelled, report.inflation = 1 if alarmed else 0, state.factor
    report.restarts = state.restarts
    report.inertia_walk, report.steps_found = walk, belief.adaptation.steps
