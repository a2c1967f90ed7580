"""Star tracker of a data sheet: noise, period of readings, and limits beyond which it is blind."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number, direction

EARTH_RADIUS = 6.378137e6  # m, at the equator
EARTH_GRAVITY = 3.986004418e14  # m^3/s^2
ORBIT_RATE_MAX = float(np.sqrt(EARTH_GRAVITY / EARTH_RADIUS**3))  # rad/s, of an orbit that grazes the Earth
_EXCLUSION_MAX = np.pi / 2.0  # rad
_NOISE_MAX = 0.01  # rad: beyond it the filter's first-order model of an attitude error no longer holds
_SAME = 1e-9  # relative, within which a period is a multiple of another


@dataclass(frozen=True, eq=False, kw_only=True)
class StarTracker(Config):
    """Star tracker: reads the attitude relative to the stars, unless it is blind.

    Attributes:
        boresight: (3,) viewing direction, body frame, of any length.
        across_std: noise of a reading about each axis across the boresight, rad.
        round_std: noise about the boresight, rad.
        period: s between two readings, a multiple of the sample period.
        rate_limit: body rate beyond which it is blind, rad/s; None: no limit.
        reacquire: s to track again after it was blind.
        sun_exclusion: angle between boresight and Sun within which it is blind, rad; None: the Sun does not blind it.
        earth_exclusion: the same beyond the Earth's limb, rad; None: the Earth does not blind it.

    Raises:
        ValueError: the boresight is no direction, or a value is out of range; the message says which.
    """

    boresight: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    across_std: float = 1e-5
    round_std: float = 1e-4
    period: float = 0.5
    rate_limit: float | None = None
    reacquire: float = 5.0
    sun_exclusion: float | None = None
    earth_exclusion: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "boresight", direction("boresight of the star tracker", self.boresight))
        for name in ("across_std", "round_std"):
            check_number(f"{name} of the star tracker, in rad,", getattr(self, name), high=_NOISE_MAX)
        check_number("period of the star tracker", self.period, strict=True)
        check_number("reacquire of the star tracker", self.reacquire)
        if self.rate_limit is not None:
            check_number("rate_limit of the star tracker", self.rate_limit, strict=True)
        for name in ("sun_exclusion", "earth_exclusion"):
            angle = getattr(self, name)
            if angle is not None:
                check_number(f"{name} of the star tracker, in rad,", angle, high=_EXCLUSION_MAX)

    def samples(self, sample_period: float) -> int:
        """Samples from one reading to the next.

        Raises:
            ValueError: the period is no multiple of the sample period, s.
        """
        ratio = self.period / sample_period
        if round(ratio) < 1 or abs(ratio - round(ratio)) > _SAME * ratio:
            raise ValueError(
                f"period of the star tracker must be a multiple of the sample period, {sample_period:g} s, "
                f"got {self.period:g} s"
            )
        return round(ratio)

    def check_sky(self, orbit_rate: float) -> None:
        """Refuse exclusions that leave no sky.

        Args:
            orbit_rate: rad/s.

        Raises:
            ValueError: the orbit is within the Earth, or Sun and Earth may exclude every direction.
        """
        if self.earth_exclusion is None:
            return
        if orbit_rate > ORBIT_RATE_MAX:
            raise ValueError(
                f"a star tracker that the Earth blinds needs an orbit above it: orbit_rate must be at most "
                f"{ORBIT_RATE_MAX:.4g} rad/s, got {orbit_rate:g}"
            )
        limb = earth_angle(orbit_rate)
        covered = (self.sun_exclusion or 0.0) + limb + self.earth_exclusion
        if covered >= np.pi:
            raise ValueError(
                f"exclusions of the star tracker must leave some sky: sun_exclusion and earth_exclusion with the "
                f"Earth's disc, {limb:.3g} rad from an orbit of {orbit_rate:g} rad/s, must be less than pi together, "
                f"got {covered:.3g} rad"
            )


def earth_angle(orbit_rate: float) -> float:
    """Angle between the Earth's centre and its limb, rad, from a circular orbit of that rate, rad/s.

    Kepler's third law gives the radius, (mu / n^2)^(1/3).
    """
    return float(np.arcsin(min(EARTH_RADIUS * (orbit_rate**2 / EARTH_GRAVITY) ** (1.0 / 3.0), 1.0)))
