"""Start of the MomentumEKF: mean and covariance after its first reading."""

from __future__ import annotations

from satid_gym.core.algebra import (
    add,
    axpy_symmetric,
    congruence,
    load,
    multiply,
    store,
    store_symmetric,
)
from satid_gym.core.belief import (
    adaptation,
    alignment,
    attitude,
    calibration,
    gating,
    inertia_step,
    modes,
    retraction,
    whiteness,
)
from satid_gym.core.belief.kalman import estimated_inertia, is_known_to, start_theta, write_times_regressor
from satid_gym.core.jit import inline, outline

_HARDLY = 0.02  # relative std of a moment: chosen by hand, as the limit in `modes`


@inline
def start(belief, work, gyro, tachometer):
    """First mean and covariance: the prior on theta, and M0 = J omega + a of the first reading."""
    start_theta(belief)
    whiteness.start(belief)
    p = belief.prior_theta.shape[0]
    gating.begin(belief, gyro, tachometer)
    calibration.start(belief)
    if belief.attitude.boresight.shape[0] > 0:
        attitude.start(belief)
    alignment.start(belief, gyro, tachometer)
    store(belief.wheel_input, calibration.wheel_input(belief, tachometer))
    if belief.adaptation.on != 0:
        adaptation.start(belief)
        inertia_step.start(belief.adaptation)
    for i in range(3):
        belief.covariance[3 + p + i, 3 + p + i] = belief.prior_torque_std**2
    if belief.modes.coupling.shape[0] > 0:
        bias = belief.calibration.bias
        variance = belief.gyro_std**2 + (belief.covariance[bias, bias] if bias > 0 else 0.0)
        modes.start(belief, calibration.corrected(belief, gyro), variance)
    start_momentum(belief, work, gyro)


@inline
def return_to_data_sheet(belief):
    """Modes, and an inertia that is hardly known, as before the first reading; one that is known may have changed."""
    if not is_known_to(belief, _HARDLY):
        for k in range(belief.prior_theta.shape[0]):
            belief.mean[3 + k] = belief.prior_theta[k]
    for i in range(belief.modes.coupling.shape[0]):
        for k in range(2, modes.STATES):
            belief.mean[belief.modes.first + modes.STATES * i + k] = 0.0


@outline
def start_momentum(belief, work, gyro):
    """M = J omega + a of one reading, with what is known of theta and with nothing of M before."""
    p, size = belief.prior_theta.shape[0], belief.mean.shape[0]
    omega, a = calibration.corrected(belief, gyro), load(belief.wheel_input)
    inertia = modes.body_inertia(belief, belief.mean, estimated_inertia(belief))
    store(belief.mean, add(add(multiply(inertia, omega), modes.momentum(belief)), a))
    retraction.start_reference(belief, omega)
    covariance, rows, identity = belief.covariance, work.rows, work.jacobian[0]
    store_symmetric(identity, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    write_times_regressor(identity, omega, work.regressor)
    for i in range(3):
        for j in range(size):
            rows[i, j] = 0.0
        for k in range(p):
            rows[i, 3 + k] = work.regressor[i, k]
    if belief.modes.coupling.shape[0] > 0:
        modes.write_rate_errors(belief, belief.mean, omega, rows)
        for i in range(3):
            for j in range(6 + p, 6 + p + modes.STATES * belief.modes.coupling.shape[0]):
                rows[i, j] = -rows[i, j]
    if belief.calibration.prior_covariance.shape[0] > 0:
        calibration.write_start_rows(belief, omega, rows)
    s2, moment = belief.gyro_std**2, work.jacobian[1]
    noise = congruence(inertia, (s2, s2, s2, 0.0, 0.0, 0.0))
    store_symmetric(moment, axpy_symmetric(1.0, noise, alignment.first_input_covariance(belief)))
    for i in range(3):
        for j in range(3, size):
            total = 0.0
            for k in range(3, size):
                total += rows[i, k] * covariance[k, j]
            covariance[i, j] = covariance[j, i] = total
    for i in range(3):
        for j in range(i, 3):
            total = moment[i, j]
            for k in range(3, size):
                total += covariance[i, k] * rows[j, k]
            covariance[i, j] = covariance[j, i] = total
