"""Gap in the wheel speeds: what it leaves open of the momentum, where the filter crosses it in a straight line."""

from __future__ import annotations

import numpy as np

from satid_gym.core.belief.filters import FilterKind
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.satellite import ReactionWheels


def widen(belief: np.void, wheels: ReactionWheels, gap: float) -> None:
    """Add to the momentum's covariance what the wheels may have done in a gap, s.

    Within the motors' limits u the body turns by up to J^-1 A u T^2 / 4 from where a line leads: at full torque for
    half the gap and back. Taken as uniform within that, the turn moves the momentum across itself. The RateEKF has no
    momentum, and keeps its covariance.

    Args:
        belief: record of a filter; its covariance is changed.
        wheels: with their torque limits.
        gap: T, s.
    """
    if belief["kind"] != FilterKind.MOMENTUM:
        return
    inertia = inertia_tensors(belief["mean"][3 : 3 + len(belief["prior_theta"])])
    turn = np.abs(np.linalg.inv(inertia) @ wheels.axes) @ wheels.max_torque * gap**2 / 4.0
    momentum = belief["mean"][:3]
    across = momentum @ momentum * np.eye(3) - np.outer(momentum, momentum)
    belief["covariance"][:3, :3] += turn.max() ** 2 / 3.0 * across
