"""Tolerances of a data sheet: how far sensors and wheels may be off nominal."""

from __future__ import annotations

from dataclasses import dataclass, fields

from satid_gym.config import Config, check_number
from satid_gym.core.sampling import UNKNOWN_DELAY_MAX

_RELATIVE_MAX = 0.1  # beyond it the filter's first-order model of an error no longer holds


@dataclass(frozen=True, eq=False, kw_only=True)
class Tolerances(Config):
    """Standard deviations of the errors of sensors and wheels that each episode draws; 0: exactly nominal.

    A filter knows these, never the drawn errors, and estimates the errors together with the inertia.

    Attributes:
        gyro_bias: of each axis at the start, rad/s.
        gyro_scale: relative error of the gyro's scale factor, by axis.
        gyro_alignment: rad, of each axis of the gyro towards the two others.
        wheel_inertia: relative error of a rotor's spin inertia, by wheel.
        wheel_alignment: rad, of a spin axis in each of the two directions across it.
        tachometer_delay: of the tachometers' delay, sample periods; it is drawn within three of it.

    Raises:
        ValueError: one is negative, a relative error or an angle is above 0.1, or the delay above 0.5.
    """

    gyro_bias: float = 0.0
    gyro_scale: float = 0.0
    gyro_alignment: float = 0.0
    wheel_inertia: float = 0.0
    wheel_alignment: float = 0.0
    tachometer_delay: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("gyro_bias", self.gyro_bias)
        check_number("tachometer_delay", self.tachometer_delay, high=UNKNOWN_DELAY_MAX)
        for field in fields(self)[1:-1]:
            check_number(field.name, getattr(self, field.name), high=_RELATIVE_MAX)

    @property
    def gyro_is_uncalibrated(self) -> bool:
        """Whether scale or alignment of the gyro is uncertain."""
        return self.gyro_scale > 0.0 or self.gyro_alignment > 0.0

    @property
    def wheels_are_uncalibrated(self) -> bool:
        """Whether inertia or alignment of the wheels is uncertain."""
        return self.wheel_inertia > 0.0 or self.wheel_alignment > 0.0

    @property
    def kinds(self) -> tuple[bool, bool, bool, bool]:
        """Whether there are errors of the gyro's bias, its scale and alignment, the tachometers' delay, the wheels."""
        return (
            self.gyro_bias > 0.0,
            self.gyro_is_uncalibrated,
            self.tachometer_delay > 0.0,
            self.wheels_are_uncalibrated,
        )

    def states(self, wheels: int) -> int:
        """Number of errors with this number of wheels."""
        return sum(size for size, on in zip((3, 9, 1, 3 * wheels), self.kinds, strict=True) if on)
