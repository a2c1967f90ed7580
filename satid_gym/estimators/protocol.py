"""Protocol of the estimators, compiled or not, as the environment asks for it.

State layout, stated once: [M, theta, tau] in momentum coordinates, [omega, theta, Omega] in rate coordinates,
theta = (Jxx, Jyy, Jzz) or (Jxx, Jyy, Jzz, Jxy, Jxz, Jyz), body frame, SI units.
"""

from __future__ import annotations

from typing import Literal, Protocol, TypeGuard

import numpy as np

from satid_gym.estimators.inertia import Parameters
from satid_gym.estimators.prior import FilterPrior


class Estimator(Protocol):
    """An online estimator of inertia from gyro and wheel speeds.

    Its state begins with a 3-vector and theta (p,): [M, theta, tau] in "momentum" coordinates (M: total
    angular momentum, tau: disturbance torque, both body frame), [omega, theta, Omega] in "rate" coordinates.
    Further states may follow. Where it has a method `command(torque)` as well, it is told the motor torque (n,),
    N m, that is commanded, before each reading. A reading that the gyro flags as invalid is not given to `update`;
    that of the tachometers then goes to the method `update_wheels(wheel_speed)`, where there is one, which returns
    what `update` does. Each reading of a star tracker goes to the method `update_attitude(attitude)`, where there is
    one, after the gyro's of the same instant: a quaternion (4,), body to inertial, scalar last.

    The observation shows the readings as they are unless the estimator has a property `accepted`, and that is not None:
    (whether the gyro's last reading was accepted, wheel speeds (n,) that it uses). Without an accepted reading of the
    gyro it shows the estimator's own rate. Info's `constrained_updates` and `rejected` stay 0.

    An attribute `settings` with settings of the library is what a policy's mission says of it; without it, the defaults
    of its coordinates.

    Attributes:
        coordinates: "momentum" or "rate".
        parameters: "principal" (p = 3), "full" (p = 6), or None: what the prior given to `reset` says is needed
            (`FilterPrior.needed_parameters`).
        mean: (size,) state.
        covariance: (size, size).
    """

    coordinates: Literal["momentum", "rate"]
    parameters: Parameters | None

    @property
    def mean(self) -> np.ndarray:
        """(size,) state."""

    @property
    def covariance(self) -> np.ndarray:
        """(size, size)."""

    def reset(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading: gyro (3,), wheel_speed (n,), rad/s."""

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds; `wheel_speed` (n,) is the reading at the end of them."""

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Take in the reading; returns the normalised innovation squared per degree of freedom."""


def is_estimator(value: object) -> TypeGuard[Estimator]:
    """Whether `value` is an object with the protocol's methods; a class does not count.

    `isinstance` would read the properties as well, up to Python 3.11, and those have no value before `reset`.
    """
    if isinstance(value, type):
        return False
    return all(callable(getattr(value, name, None)) for name in ("reset", "predict", "update"))
