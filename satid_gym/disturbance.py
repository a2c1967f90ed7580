"""Settings of the external torque on the satellite."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.config import Config, check_number, real_array


@dataclass(frozen=True, eq=False, kw_only=True)
class Disturbance(Config):
    """External torque on the satellite; every part is 0 or off by default.

    Attributes:
        constant: (3,) N m, body frame.
        cosine: (3,) N m, body frame, times cos(orbit_rate t).
        sine: (3,) N m, body frame, times sin(orbit_rate t).
        gravity_gradient: whether 3 n^2 r x J r acts, r the nadir of a circular orbit in the inertial x-y plane.
        solar_force: (3,) N, inertial frame.
        solar_offset: (3,) m, body frame, centre of pressure from centre of mass.
        orbit_rate: n, rad/s.

    Raises:
        ValueError: a value is not finite or has another shape.
    """

    constant: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    cosine: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    sine: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity_gradient: bool = False
    solar_force: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    solar_offset: np.ndarray | tuple[float, float, float] = (0.0, 0.01, 0.0)
    orbit_rate: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("constant", "cosine", "sine", "solar_force", "solar_offset"):
            object.__setattr__(self, name, real_array(f"disturbance {name}", getattr(self, name), (3,)))
        check_number("orbit_rate", self.orbit_rate)
