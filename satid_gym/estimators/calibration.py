"""Prior of the calibration errors: covariance of gyro and wheel errors that a data sheet's tolerances allow."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from satid_gym.estimators.alignment import noise_covariance, noise_taps
from satid_gym.estimators.prior import FilterPrior
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.tolerances import Tolerances


def wheel_error_covariance(wheels: ReactionWheels, tolerances: Tolerances) -> np.ndarray:
    """Covariance (3 n, 3 n) of the errors e_k of the wheels' momentum by speed, without their common part, kg^2 m^4.

    Along its axis e_k is j_k times the relative error of the rotor inertia less the mean of all wheels', which no
    excitation finds; across it, j_k times the misalignment.
    """
    n = wheels.count
    covariance = np.zeros((n, 3, n, 3))
    relative = tolerances.wheel_inertia**2 * (np.eye(n) - np.full((n, n), 1.0 / n))
    for k, (axis, inertia) in enumerate(zip(wheels.axes.T, wheels.inertia, strict=True)):
        across = np.eye(3) - np.outer(axis, axis)
        covariance[k, :, k] += (inertia * tolerances.wheel_alignment) ** 2 * across
        for q in range(n):
            product = inertia * wheels.inertia[q] * np.outer(axis, wheels.axes[:, q])
            covariance[k, :, q] += relative[k, q] * product
    return covariance.reshape(3 * n, 3 * n)


def calibration_covariance(wheels: ReactionWheels, tolerances: Tolerances) -> np.ndarray:
    """Covariance of the errors before the first reading, (c, c).

    In order: the gyro's bias, its scale and alignment, the tachometers' delay, the wheels.
    """
    bias = tolerances.gyro_bias**2 * np.eye(3)
    gain = np.full((3, 3), tolerances.gyro_alignment**2)
    np.fill_diagonal(gain, tolerances.gyro_scale**2)
    delay = np.array([[tolerances.tachometer_delay**2]])
    parts = (bias, np.diag(gain.ravel()), delay, wheel_error_covariance(wheels, tolerances))
    return scipy.linalg.block_diag(*(part for part, on in zip(parts, tolerances.kinds, strict=True) if on))


def write_calibration(row: np.void, prior: FilterPrior, first: int, calibrate: bool) -> None:
    """Write what is known of the errors to a belief record, whose mean has them from index `first` on.

    Those of the tolerances, which are left out without `calibrate`, then those of encoders.
    """
    tolerances, wheels = prior.tolerances if calibrate else Tolerances(), prior.wheels
    calibration, taps = row["calibration"], noise_taps(prior)
    states, sizes = tolerances.states(wheels.count), (3, 9, 1, 3 * wheels.count)
    covariance = calibration["prior_covariance"]
    covariance[:states, :states] = calibration_covariance(wheels, tolerances)
    for name, size, on in zip(("bias", "gain", "delay", "wheels"), sizes, tolerances.kinds, strict=True):
        if on:
            calibration[name], first = first, first + size
    for tap in range(taps):
        place = slice(states + 3 * tap, states + 3 * tap + 3)
        covariance[place, place] = noise_covariance(prior)
    calibration["spins"] = calibration["wheels"] or first
    calibration["spin_count"] = taps + (wheels.count if tolerances.wheels_are_uncalibrated else 0)
    if tolerances.gyro_bias > 0.0:
        row["walk"][calibration["bias"] : calibration["bias"] + 3] = prior.gyro_bias_walk
    row["scale_variance"] = tolerances.wheel_inertia**2 / wheels.count
