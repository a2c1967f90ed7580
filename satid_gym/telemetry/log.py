"""Log: the readings of one flight, in SI units and the body frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

CHANNELS = ("rate", "wheel_speed", "attitude", "torque", "motor_torque")
REPEATS_MAX = 0.05  # share of readings that repeat the one before: with more it is a coarse sensor
GAP = 2.5  # medians beyond which an interval is a gap


@dataclass(frozen=True, eq=False, kw_only=True)
class Log:
    """Readings of one flight; NaN is a missing reading, and infinities become NaN.

    Attributes:
        time: (N,) s, of any clock; increasing.
        rate: (N, 3) gyro, rad/s, body frame.
        wheel_speed: (N, n) relative to the body, rad/s.
        attitude: (N, 4) quaternion, body to inertial, scalar last, or None.
        torque: (N, 3) torque on the body from outside that is known, such as magnetorquers' or thrusters', N m, body
            frame, or None.
        motor_torque: (N, n) of the motors on the wheels, N m, or None; the body feels the opposite.
        name: what pages call the flight.
        notes: what was found while reading, a line each: units taken, rows left out, gaps.
        units: that the readings were taken to be in, by role; empty for a log that no file was read for.
        stated: the roles whose unit the files state.

    Raises:
        ValueError: a shape is wrong, a stamp is not finite, or stamps do not increase.
    """

    time: np.ndarray
    rate: np.ndarray
    wheel_speed: np.ndarray
    attitude: np.ndarray | None = None
    torque: np.ndarray | None = None
    motor_torque: np.ndarray | None = None
    name: str = "log"
    notes: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    stated: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name in ("time", *CHANNELS):
            if getattr(self, name) is not None:
                value = np.array(getattr(self, name), dtype=float)
                object.__setattr__(self, name, value if name == "time" else np.where(np.isfinite(value), value, np.nan))
        count = len(self.time) if self.time.ndim == 1 else -1
        if count < 2:
            raise ValueError(f"time of a log must have shape (N,) with N >= 2, got {self.time.shape}")
        if self.rate.shape != (count, 3):
            raise ValueError(f"rate of a log must have shape ({count}, 3), got {self.rate.shape}")
        if self.wheel_speed.ndim != 2 or len(self.wheel_speed) != count or self.wheel_speed.shape[1] < 3:
            raise ValueError(
                f"wheel_speed of a log must have shape ({count}, n) with n >= 3, got {self.wheel_speed.shape}"
            )
        for name, width in (("attitude", 4), ("torque", 3), ("motor_torque", self.wheel_speed.shape[1])):
            value = getattr(self, name)
            if value is not None and value.shape != (count, width):
                raise ValueError(f"{name} of a log must have shape ({count}, {width}) or be None, got {value.shape}")
        if not np.isfinite(self.time).all() or (np.diff(self.time) <= 0.0).any():
            raise ValueError("time of a log must be finite and increase from row to row; read_log sorts the rows")

    @property
    def interval(self) -> float:
        """Median time between two rows, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Start and length, s, of the intervals that are longer than 2.5 medians."""
        steps = np.diff(self.time)
        return [(float(self.time[i]), float(steps[i])) for i in np.flatnonzero(steps > GAP * self.interval)]

    def rows(self, keep: np.ndarray) -> Self:
        """The log with only the rows (N,) to keep."""
        there = {name: getattr(self, name) for name in CHANNELS}
        kept: dict[str, Any] = {name: value if value is None else value[keep] for name, value in there.items()}
        return replace(self, time=self.time[keep], **kept)

    def __len__(self) -> int:
        return len(self.time)
