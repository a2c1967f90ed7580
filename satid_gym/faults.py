"""Settings of the faults of sensors, wheels and commands in an episode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.config import Config, check_number, unknown_name
from satid_gym.core import records

FAULTS = tuple(fault.name.lower() for fault in records.Fault)
"""Order of `info["faults"]`, which says for each of these faults whether it acted in a decision."""

SWITCHES = ("gyro_dropout", "gyro_outlier", "gyro_bias_std", "tachometer_stuck", "wheel_loss", "torque_delay")
"""Settings that turn a fault on if they are not 0."""

_PROBABILITIES = ("gyro_dropout", "gyro_dropout_silent", "gyro_outlier", "tachometer_stuck", "wheel_loss")
_SHARES = ("time", "wheel_loss_size")
_RANGES = ("gyro_dropout_duration", "gyro_outlier_size", "tachometer_stuck_duration")


@dataclass(frozen=True, eq=False, kw_only=True)
class Faults(Config):
    """Faults of sensors and actuators; none unless a probability or size is given.

    Dropout, stuck tachometer and wheel loss each occur at most once per episode, at independent times. Values are drawn
    uniformly from the ranges (low, high).

    Attributes:
        time: start of dropout, stuck tachometer and wheel loss, as fractions of the horizon.
        gyro_dropout: probability that the gyro delivers no new reading for a while; the last one is repeated.
        gyro_dropout_duration: s.
        gyro_dropout_silent: probability that such a dropout is not flagged as invalid.
        gyro_outlier: probability per sample of a spike on one axis.
        gyro_outlier_size: size of a spike, of either sign, in standard deviations of the gyro's noise.
        gyro_bias_std: std of the gyro's initial bias, rad/s.
        tachometer_stuck: probability that one wheel's tachometer repeats its last reading for a while.
        tachometer_stuck_duration: s.
        wheel_loss: probability that one wheel loses a part of its motor torque from some moment on.
        wheel_loss_size: share of the torque that is lost; 1: the wheel has failed.
        torque_delay: delay of torque commands in samples, an integer drawn for each episode.

    Raises:
        ValueError: a value is out of range.
    """

    time: Sequence[float] = (0.2, 0.6)
    gyro_dropout: float = 0.0
    gyro_dropout_duration: Sequence[float] = (5.0, 20.0)
    gyro_dropout_silent: float = 0.0
    gyro_outlier: float = 0.0
    gyro_outlier_size: Sequence[float] = (10.0, 200.0)
    gyro_bias_std: float = 0.0
    tachometer_stuck: float = 0.0
    tachometer_stuck_duration: Sequence[float] = (20.0, 60.0)
    wheel_loss: float = 0.0
    wheel_loss_size: Sequence[float] = (0.3, 1.0)
    torque_delay: Sequence[int] = (0, 0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in _PROBABILITIES:
            check_number(name, getattr(self, name), high=1.0)
        check_number("gyro_bias_std", self.gyro_bias_std)
        for name in (*_SHARES, *_RANGES, "torque_delay"):
            self._check_range(name, high=1.0 if name in _SHARES else np.inf)
        if not all(isinstance(samples, (int, np.integer)) for samples in self.torque_delay):
            raise ValueError(f"torque_delay must be integers (samples), got {self.torque_delay!r}")

    def _check_range(self, name: str, high: float) -> None:
        value = getattr(self, name)
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
            raise ValueError(f"{name} must be a range (low, high), got {value!r}")
        for end in value:
            check_number(name, end, high=high)
        if value[0] > value[1]:
            raise ValueError(f"{name} must be a range (low, high) with low <= high, got {value!r}")
        object.__setattr__(self, name, tuple(value))

    @property
    def possible(self) -> bool:
        """Whether any fault is possible."""
        return any(np.max(getattr(self, name)) > 0 for name in SWITCHES)

    def only(self, switch: str) -> Faults:
        """These faults with all switched off except one of `SWITCHES`.

        Raises:
            ValueError: there is no such switch.
        """
        if switch not in SWITCHES:
            raise unknown_name("fault", switch, SWITCHES)
        none = Faults()
        off = {name: getattr(none, name) for name in SWITCHES if name != switch}
        return self.replace(**off)
