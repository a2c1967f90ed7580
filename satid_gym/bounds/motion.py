"""True motion, from which bounds are computed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False, kw_only=True)
class TrueMotion:
    """True trajectories of N episodes at T instants, evenly spaced; body frame, SI units.

    Attributes:
        momentum: (N, T, 3) M, N m s.
        rate: (N, T, 3) omega, rad/s.
        wheel_speed: (N, T, n) Omega, rad/s.
        inertia: (N, T, 3, 3) J, kg m^2.
        torque: (N, T, 3) external torque, N m.
    """

    momentum: np.ndarray
    rate: np.ndarray
    wheel_speed: np.ndarray
    inertia: np.ndarray
    torque: np.ndarray
