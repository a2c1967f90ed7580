"""What the observation says, back in physical units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from satid_gym.estimators.settings import PRODUCTS
from satid_gym.policy import Mission


@dataclass(frozen=True, eq=False, kw_only=True)
class Belief:
    """What N episodes measure and believe, body frame.

    Attributes:
        omega: (N, 3) measured body rate, rad/s.
        wheel_momentum: (N, n) j Omega of each wheel, N m s.
        inertia: (N, 3, 3) estimated, kg m^2.
        inertia_std: (N, 3) standard deviation of the moments, relative to their prior.
        momentum: (N, 3) J omega + A j Omega, N m s.
        disturbance: (N, 3) estimated external torque, N m.
    """

    omega: np.ndarray
    wheel_momentum: np.ndarray
    inertia: np.ndarray
    inertia_std: np.ndarray
    momentum: np.ndarray
    disturbance: np.ndarray

    @classmethod
    def read(cls, observation: np.ndarray, mission: Mission) -> Self:
        """From observations (N, size) and what was known before the flight."""
        satellite, wheels = mission.satellite, mission.satellite.wheels
        part = {name: observation[:, place].astype(float) for name, place in mission.layout.items()}
        omega = part["rate"] * satellite.rate_limit
        wheel_momentum = part["wheel_speed"] * wheels.max_speed * wheels.inertia
        inertia = _inertia(part["inertia"], mission.prior_inertia)
        return cls(
            omega=omega,
            wheel_momentum=wheel_momentum,
            inertia=inertia,
            inertia_std=10.0 ** (part["uncertainty"][:, :3] - 2.0),
            momentum=np.einsum("nij,nj->ni", inertia, omega) + wheel_momentum @ wheels.axes.T,
            disturbance=part["disturbance"] * satellite.disturbance_std,
        )


def _inertia(change: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Tensors (N, 3, 3) from changes (N, p) of the parameters, relative to the scales of the observation."""
    moments = np.diag(prior)
    inertia = np.zeros((len(change), 3, 3))
    for i in range(3):
        inertia[:, i, i] = moments[i] * (1.0 + change[:, i])
    for k, (i, j) in enumerate(PRODUCTS[: change.shape[1] - 3]):
        product = prior[i, j] + np.sqrt(moments[i] * moments[j]) * change[:, 3 + k]
        inertia[:, i, j] = inertia[:, j, i] = product
    return inertia
