"""Operations of a payload: imaging windows, pointing accuracy, and a keep-out around the Sun."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number, direction

SLEW_MAX = 2.0  # rad, from one target to the next
_DEGREE = float(np.pi / 180.0)  # rad
_KEEP_OUT_MAX = np.pi / 4.0  # rad, with the clearance


@dataclass(frozen=True, eq=False, kw_only=True)
class Operations(Config):
    """Imaging windows, one after the other, each with a target that the payload points to while it is open.

    Values are drawn uniformly from the ranges (low, high). An episode's windows do not depend on the policy.

    Attributes:
        boresight: (3,) viewing direction of the payload, body frame, of any length.
        gap: s from the start, or from the closing of a window, to the next opening.
        window: s that a window is open.
        slew: angle from one target to the next, as a share of the angle turned in the gap at the rate limit; at most 2
            rad.
        pointing: rad, largest angle between boresight and target while a window is open.
        steadiness: rad/s, largest body rate while a window is open.
        keep_out: rad, smallest allowed angle between boresight and Sun at all times; 0: no limit.
        clearance: rad, additional distance of targets, and of the boresight at the start, from the Sun.

    Raises:
        ValueError: a range is reversed, or a value is out of range; the message says which.
    """

    boresight: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    gap: tuple[float, float] = (35.0, 60.0)
    window: tuple[float, float] = (20.0, 40.0)
    slew: tuple[float, float] = (0.2, 0.6)
    pointing: float = 0.2 * _DEGREE
    steadiness: float = 0.02 * _DEGREE
    keep_out: float = 25.0 * _DEGREE
    clearance: float = 5.0 * _DEGREE

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "boresight", direction("boresight of the payload", self.boresight))
        for name, high in (("gap", np.inf), ("window", np.inf), ("slew", 1.0)):
            low, top = (check_number(f"{name} of the operations", x, high=high, strict=True) for x in self._pair(name))
            if low > top:
                raise ValueError(f"{name} of the operations must be (low, high), got {getattr(self, name)}")
        for name in ("pointing", "steadiness"):
            check_number(f"{name} of the operations", getattr(self, name), strict=True)
        for name in ("keep_out", "clearance"):
            check_number(f"{name} of the operations, in rad,", getattr(self, name), high=_KEEP_OUT_MAX)
        if self.keep_out + self.clearance > _KEEP_OUT_MAX:
            raise ValueError(
                f"keep_out and clearance of the operations must be at most {_KEEP_OUT_MAX:.3g} rad together, so that "
                f"targets are left, got {self.keep_out + self.clearance:.3g} rad"
            )

    def _pair(self, name: str) -> tuple[float, float]:
        value = getattr(self, name)
        if len(value) != 2:
            raise ValueError(f"{name} of the operations must be (low, high), got {value}")
        return value
