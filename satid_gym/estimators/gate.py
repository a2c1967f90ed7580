"""Gate of the filter: what it takes for outliers and for tachometers that are stuck, by a data sheet's sensors."""

from __future__ import annotations

import numpy as np

from satid_gym.core.sampling import DELAY_SIGMAS
from satid_gym.estimators.alignment import Alignment
from satid_gym.estimators.prior import FilterPrior

_COUNTS = 2.0  # the counts of a wheel that turns evenly differ by one, so that equal ones may hide nearly two


def write_gate(gate: np.void, prior: FilterPrior, threshold: float) -> None:
    """Write the gate's settings to its record; `threshold` is the normalised innovation squared, 0 for no gate."""
    gate["threshold"], gate["gyro_noisy"], gate["torque_max"] = threshold, prior.gyro_is_noisy, prior.wheels.max_torque
    gate["slack"], gate["suspect"] = _slack(prior), _count(prior)
    if prior.sensors.are_timed:  # readings of the gyro are averaged by the tachometers' weights
        unknown = prior.tolerances.tachometer_delay
        own = Alignment.of(prior.sensors, unknown)
        is_whole = unknown == 0.0 and own.tachometer_delay % 1.0 == 0.0
        gate["spread"] = own.tachometer_averaged + (not is_whole)


def _slack(prior: FilterPrior) -> float | np.ndarray:
    """Change of wheel speed, rad/s, that commands may make while a tachometer rightly repeats its reading.

    A noisy one never does, and one without noise may always. One that counts pulses may until the change shows, late.
    """
    sensors, wheels, period = prior.sensors, prior.wheels, prior.sample_period
    if not sensors.counts:
        return 0.0 if prior.tachometer_noise_std > 0.0 else np.inf
    assert period is not None
    late = sensors.tachometer_delay + DELAY_SIGMAS * prior.tolerances.tachometer_delay + 1.0
    return _COUNTS * _count(prior) + late * period * wheels.max_torque / wheels.inertia


def _count(prior: FilterPrior) -> float:
    """Wheel speed of one pulse a sample, rad/s; infinite where pulses are not counted."""
    pulses, period = prior.sensors.encoder_pulses, prior.sample_period
    return np.inf if pulses is None or period is None else 2.0 * np.pi / pulses / period
