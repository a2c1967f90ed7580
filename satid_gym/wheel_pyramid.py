"""Wheels that a scenario gives its satellites: four on a pyramid, sized for the body, with speeds to avoid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.config import Config, check_number, real_array
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.satellite import Satellite

_AZIMUTHS = np.pi * np.array([0.25, 0.75, -0.25, -0.75])  # of the spin axes about z
_DIAGONAL = float(np.arctan(np.sqrt(0.5)))
_UPRIGHT = 1.5  # rad, beyond which the wheels hardly turn the body about x and y


@dataclass(frozen=True, eq=False, kw_only=True)
class WheelPyramid(Config):
    """Four wheels on a pyramid about the z axis, with inertia, torque and friction of the satellite's first wheel.

    Attributes:
        momentum: of a wheel at its speed limit, over that of the body about the axis of its largest moment of inertia
            at the rate limit; the speed limit follows from it.
        elevation: of the spin axes above the pyramid's base, rad; by default they are diagonals of a cube.
        avoided: (low, high) band of wheel speed, in both directions, that operators avoid, over the speed limit.

    Raises:
        ValueError: a value is out of range.
    """

    momentum: float = 1.6
    elevation: float = _DIAGONAL
    avoided: tuple[float, float] = (0.0, 0.05)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("momentum of the wheel pyramid", self.momentum, strict=True)
        check_number("elevation of the wheel pyramid, in rad,", self.elevation, strict=True, high=_UPRIGHT)
        low, high = real_array("avoided of the wheel pyramid", self.avoided, (2,)).tolist()
        if not 0.0 <= low <= high < 1.0:
            raise ValueError(
                f"avoided of the wheel pyramid must be (low, high) with 0 <= low <= high < 1, got ({low}, {high})"
            )
        object.__setattr__(self, "avoided", (low, high))

    def equip(self, satellite: Satellite, rate_limit: float | None = None) -> Satellite:
        """The satellite with these wheels in place of its own.

        Args:
            satellite: to take them.
            rate_limit: rad/s; None: the satellite's.
        """
        own, level = satellite.wheels, np.cos(self.elevation)
        up = np.full(len(_AZIMUTHS), np.sin(self.elevation))
        body_rate = satellite.rate_limit if rate_limit is None else rate_limit
        body = float(np.linalg.eigvalsh(satellite.inertia)[-1]) * body_rate  # N m s
        max_speed = self.momentum * body / own.inertia[0]
        wheels = ReactionWheels(
            axes=np.stack([level * np.cos(_AZIMUTHS), level * np.sin(_AZIMUTHS), up]),
            inertia=own.inertia[0],
            max_torque=own.max_torque[0],
            max_speed=max_speed,
            friction=own.friction,
            avoided_speed=(self.avoided[0] * max_speed, self.avoided[1] * max_speed),
        )
        return satellite.replace(wheels=wheels)
