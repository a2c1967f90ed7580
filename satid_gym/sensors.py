"""Sensors of a data sheet: averaging, counting and delays of gyro and tachometers, and a star tracker."""

from __future__ import annotations

from dataclasses import dataclass

from satid_gym.config import Config, check_integer, check_number
from satid_gym.core.sampling import DELAY_MAX, DELAY_SIGMAS, LINE
from satid_gym.star_tracker import StarTracker
from satid_gym.tolerances import Tolerances


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensors(Config):
    """Gyro, tachometers and star tracker; by default there is no tracker, and each reading is the value of the instant
    at which it is given.

    Attributes:
        gyro_integrates: whether a reading is the rate's mean over the sample period, as of a rate-integrating gyro,
            whose angle increment is divided by the period.
        gyro_delay: delay of a reading, in sample periods.
        gyro_quantum: angle quantum of an integrating gyro, rad; the remainder goes into the next increment.
        gyro_range: rate about any axis beyond which the gyro flags its reading as invalid, rad/s; None: no limit.
        encoder_pulses: pulses a revolution of the wheel that are counted over the sample period; tachometer_noise_std
            then has no effect. None: the tachometers measure wheel speed.
        tachometer_delay: delay of a reading, in sample periods.
        star_tracker: a `StarTracker` or a mapping with its settings; None: no star tracker. Its readings are of the
            instant at which they are given.

    Raises:
        ValueError: a delay is not within 0 and 4 periods, a quantum is negative or that of a gyro that does not
            integrate, or there are less than one pulse.
    """

    gyro_integrates: bool = False
    gyro_delay: float = 0.0
    gyro_quantum: float = 0.0
    gyro_range: float | None = None
    encoder_pulses: int | None = None
    tachometer_delay: float = 0.0
    star_tracker: StarTracker | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("gyro_delay", "tachometer_delay"):
            check_number(f"{name}, in sample periods,", getattr(self, name), high=DELAY_MAX)
        check_number("gyro_quantum", self.gyro_quantum)
        if self.gyro_quantum > 0.0 and not self.gyro_integrates:
            raise ValueError(
                f"gyro_quantum is that of angle increments: a gyro with {self.gyro_quantum:g} rad needs "
                "gyro_integrates=True"
            )
        if self.gyro_range is not None:
            check_number("gyro_range", self.gyro_range, strict=True)
        if self.encoder_pulses is not None:
            check_integer("encoder_pulses", self.encoder_pulses)
        if self.star_tracker is not None:
            self._settle("star_tracker", StarTracker)

    @property
    def counts(self) -> bool:
        """Whether the tachometers count pulses."""
        return self.encoder_pulses is not None

    @property
    def are_timed(self) -> bool:
        """Whether a reading of gyro or tachometers is not the value of the instant at which it is given."""
        return self.gyro_integrates or self.counts or self.gyro_delay > 0.0 or self.tachometer_delay > 0.0

    @property
    def lines(self) -> int:
        """Readings that a record of truth or belief has room for; 0 where none is kept."""
        return LINE if self.are_timed else 0

    def check(self, tolerances: Tolerances) -> None:
        """Refuse tolerances that these sensors cannot have.

        Raises:
            ValueError: a reading could come before its time.
        """
        if DELAY_SIGMAS * tolerances.tachometer_delay > self.tachometer_delay * (1.0 + 1e-9):
            raise ValueError(
                f"tolerance tachometer_delay must be at most a third of the sensors' tachometer_delay, because "
                f"no reading comes before its time: got {tolerances.tachometer_delay:g} of "
                f"{self.tachometer_delay:g} periods"
            )
