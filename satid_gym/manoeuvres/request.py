"""Request of a manoeuvre: duration, accuracy, and where the satellite may point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from satid_gym.config import Config, check_number, real_array


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepOut(Config):
    """Cone around a direction that a boresight must stay out of, such as a star tracker's around the Sun.

    Attributes:
        boresight: (3,) in the body frame; any length.
        direction: (3,) direction to avoid, in the body frame at the start of the manoeuvre; any length.
        angle: half of the cone's opening, rad.

    Raises:
        ValueError: a direction is zero, or the angle is not within 0 and pi.
    """

    boresight: np.ndarray
    direction: np.ndarray
    angle: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("boresight", "direction"):
            vector = real_array(f"{name} of a keep-out", getattr(self, name), (3,))
            length = np.linalg.norm(vector)
            if length == 0.0:
                raise ValueError(f"{name} of a keep-out must have a length, got {vector.tolist()}")
            object.__setattr__(self, name, vector / length)
        if not 0.0 < check_number("angle of a keep-out", self.angle) < np.pi:
            raise ValueError(f"angle of a keep-out must be between 0 and pi rad, got {self.angle:g}")

    def separation(self, boresight: np.ndarray) -> np.ndarray:
        """Angle (...) between boresights (..., 3), in the frame of `direction`, and what is avoided, rad."""
        return np.arccos(np.clip(boresight @ self.direction, -1.0, 1.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Request(Config):
    """Requirements of a manoeuvre.

    Attributes:
        duration: s, from rest to rest; an integer multiple of the scenario's decision period.
        accuracy: largest standard deviation of a moment of inertia at the end, relative to the moment; None: the best
            possible.
        returns: whether it ends in its initial attitude.
        turn_limit: largest angle from that attitude, rad; None: any.
        keep_outs: cones that boresights stay out of, or mappings with their settings.
        cost_limit: share of the time, in the mean over satellites drawn, that rates, wheels or deflections may be
            beyond their limits.

    Raises:
        ValueError: a value is out of range, or a boresight begins within its keep-out.
    """

    duration: float = 300.0
    accuracy: float | None = None
    returns: bool = False
    turn_limit: float | None = None
    keep_outs: tuple[KeepOut, ...] = field(default=())
    cost_limit: float = 0.01

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("duration", self.duration, strict=True)
        check_number("cost_limit", self.cost_limit, high=1.0)
        if self.accuracy is not None:
            check_number("accuracy", self.accuracy, strict=True, high=1.0)
        if self.turn_limit is not None:
            check_number("turn_limit", self.turn_limit, strict=True, high=np.pi)
        object.__setattr__(self, "keep_outs", tuple(_keep_out(value) for value in self.keep_outs))
        for keep_out in self.keep_outs:
            start = keep_out.separation(keep_out.boresight)
            if start <= keep_out.angle:
                raise ValueError(
                    f"boresight {keep_out.boresight.round(4).tolist()} begins {np.degrees(start):.1f} deg from "
                    f"{keep_out.direction.round(4).tolist()}, within its keep-out of {np.degrees(keep_out.angle):.1f} "
                    "deg: begin in another attitude, or make the angle smaller"
                )


def _keep_out(value: KeepOut | Mapping[str, Any]) -> KeepOut:
    return value if isinstance(value, KeepOut) else KeepOut.from_dict(value)
