"""Alignment of the filter: delays, weights and noise states that follow from a data sheet's sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, Self

import numpy as np

from satid_gym.core.sampling import DELAY_SIGMAS, taps, write_weights
from satid_gym.estimators.prior import FilterPrior, counting_std
from satid_gym.modes import Mode
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances


class DataSheet(Protocol):
    """What decides the states of a filter: a satellite or a filter's prior."""

    @property
    def wheels(self) -> ReactionWheels:
        """Reaction wheels."""

    @property
    def tolerances(self) -> Tolerances:
        """How far sensors and wheels may be off nominal."""

    @property
    def sensors(self) -> Sensors:
        """What readings stand for."""

    @property
    def modes(self) -> Sequence[Mode]:
        """Modes of panels and slosh masses."""


class Alignment(NamedTuple):
    """How late gyro and tachometers are, and whether they are means of a sample period, less what both have in common.

    Delays are in sample periods.
    """

    gyro_delay: float
    gyro_averaged: bool
    tachometer_delay: float
    tachometer_averaged: bool

    @classmethod
    def of(cls, sensors: Sensors, unknown: float) -> Self:
        """That of sensors whose tachometers' delay is known to a standard deviation of `unknown` sample periods."""
        gyro, wheels = sensors.gyro_delay, sensors.tachometer_delay
        if unknown == 0.0 and gyro == wheels and sensors.gyro_integrates == sensors.counts:
            return cls(0.0, False, 0.0, False)
        common = int(max(min(gyro, wheels - DELAY_SIGMAS * unknown), 0.0))
        return cls(gyro - common, sensors.gyro_integrates, wheels - common, sensors.counts)


def noise_taps(sheet: DataSheet) -> int:
    """Number of counts of an encoder that stand in an aligned wheel speed; 0 without encoder."""
    if not sheet.sensors.counts:
        return 0
    own = Alignment.of(sheet.sensors, sheet.tolerances.tachometer_delay)
    return taps(own.gyro_delay, own.gyro_averaged) + 1


def noise_covariance(prior: FilterPrior) -> np.ndarray:
    """Covariance (3, 3) of A j v / dt, N^2 m^2 s^2, where v are the errors of the wheels' angles as counted."""
    wheels, pulses, period = prior.wheels, prior.sensors.encoder_pulses, prior.sample_period
    assert pulses is not None
    assert period is not None
    spin_std = wheels.inertia * counting_std(2.0 * np.pi / pulses) / period
    covariance = (wheels.axes * spin_std**2) @ wheels.axes.T
    return 0.5 * (covariance + covariance.T)  # a matrix product need not be symmetric to the last bit


def write_alignment(row: np.void, prior: FilterPrior) -> None:
    """Write what the sensors are to a belief record, whose mean ends with the errors of encoders."""
    sensors, counts = prior.sensors, noise_taps(prior)
    alignment = row["alignment"]
    own = Alignment.of(sensors, prior.tolerances.tachometer_delay)
    for name, value in own._asdict().items():
        alignment[name] = value
    ends = taps(own.gyro_delay, own.gyro_averaged) + taps(own.tachometer_delay, own.tachometer_averaged)
    alignment["span"] = max(ends - 2, int(sensors.gyro_integrates))
    alignment["age"] = sensors.gyro_delay + 0.5 * sensors.gyro_integrates
    alignment["state_age"] = alignment["age"] + own.tachometer_delay + 0.5 * own.tachometer_averaged
    alignment["noise_taps"] = counts
    if sensors.are_timed:
        write_weights(sensors.gyro_delay, int(sensors.gyro_integrates), alignment["gyro_end_weight"])
        if sensors.star_tracker is not None:
            row["attitude"]["wait"] = round(alignment["state_age"])
    if counts > 0:
        alignment["noise"] = len(row["mean"]) - 3 * counts
        alignment["noise_covariance"] = noise_covariance(prior)
        row["wheel_momentum_covariance"] = alignment["noise_covariance"]
