"""Friction of reaction wheels, as a data sheet states it."""

from __future__ import annotations

from dataclasses import dataclass

from satid_gym.config import Config, check_number

_SPEED_MIN = 0.01  # rad/s: below it the passage through zero takes thousands of steps of the integrator


@dataclass(frozen=True, eq=False, kw_only=True)
class WheelFriction(Config):
    """Friction between each rotor and the body; for the equation see `satid_gym.core.truth.friction`.

    Attributes:
        coulomb: torque that opposes the motion at any speed, N m; 0: none.
        static: torque at which a wheel breaks away from rest, N m, at least `coulomb`; None: as much.
        viscous: torque by speed, N m s.
        stribeck_speed: rad/s, at which a wheel has broken away; several times that speed stiction has gone.

    Raises:
        ValueError: a value is out of range.
    """

    coulomb: float = 0.0
    static: float | None = None
    viscous: float = 0.0
    stribeck_speed: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("coulomb friction", self.coulomb)
        check_number("viscous friction", self.viscous)
        if self.static is not None:
            check_number("static friction", self.static, low=self.coulomb)
        check_number("stribeck_speed", self.stribeck_speed, low=_SPEED_MIN)

    @property
    def breakaway(self) -> float:
        """Torque at which a wheel breaks away from rest, N m."""
        return self.coulomb if self.static is None else self.static

    @property
    def acts(self) -> bool:
        """Whether there is any friction."""
        return self.breakaway > 0.0 or self.viscous > 0.0
