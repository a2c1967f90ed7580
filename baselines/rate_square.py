"""Closed-loop excitation: body rates that follow square waves just inside the envelope.

The information on a moment of inertia grows with the square of its body rate, so the rate should sit at the
limit, one side and then the other, on each axis; axes change sides a third of a period apart.

The law is deadbeat: the torque that brings the rate to its reference at the end of the decision,

    -A u = (J - A j A^T) (omega_ref - omega) / T + omega_mid x M - tau,    omega_mid = (omega + omega_ref) / 2

from dM/dt = -omega x M + tau and h = j (Omega + A^T omega). No law does better against motor noise that is
white from decision to decision: what is left is the noise of one decision. The reference keeps `margin`
standard deviations of that noise away from the limit, and the wheels' momentum as far from theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baselines.belief import Belief
from satid_gym.config import check_number
from satid_gym.policy import Kind, Mission
from satid_gym.profiles import wheel_torque

_STAGGER = np.array([0.0, 1.0, 2.0]) / 3.0  # of a period


class RateSquarePolicy:
    """Tracks staggered square waves of body rate.

    Args:
        period: of the square wave, s.
        margin: distance of the reference from the rate limit and from the wheel speed limit, in standard
            deviations of what one decision's noise does to them.

    Raises:
        ValueError: the period is not positive or the margin is negative.
    """

    name = "rate_square"
    kind: Kind = "closed_loop"

    def __init__(self, period: float, margin: float) -> None:
        self.period = check_number("period", period, strict=True)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Take in the satellite and its noise."""
        self._mission = mission
        wheels = mission.satellite.wheels
        self._duration = mission.scenario.decision_period
        self._impulse_std = mission.scenario.torque_noise * wheels.max_torque * self._duration
        self._wheel_limit = np.maximum(wheels.inertia * wheels.max_speed - self.margin * self._impulse_std, 0.0)
        self._decision = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        wheels, dt = self._mission.satellite.wheels, self._duration
        belief = Belief.read(observation, self._mission)
        reference = self._attainable(belief, self._reference(belief))
        locked = belief.inertia - wheels.carried_inertia
        middle = belief.omega
        for _ in range(2):  # the second time with the rate that the limited torque will reach
            drift = belief.disturbance - np.cross(middle, belief.momentum)
            wanted = wheel_torque(_times(locked, reference - belief.omega) / dt - drift, wheels)
            motor = np.clip(wanted, -wheels.max_torque, wheels.max_torque)
            middle = belief.omega + 0.5 * dt * _solve(locked, drift - motor @ wheels.axes.T)
        self._decision += 1
        return motor / wheels.max_torque

    def _reference(self, belief: Belief) -> np.ndarray:
        """(N, 3) rad/s, sides of the square waves less the margin for noise and for what J may really be."""
        phase = (self._decision + 0.5) * self._duration / self.period + _STAGGER
        side = np.where(np.mod(phase, 1.0) < 0.5, 1.0, -1.0)
        satellite = self._mission.satellite
        limit = satellite.rate_limit
        noise = np.linalg.norm(np.linalg.inv(belief.inertia) @ satellite.wheels.axes * self._impulse_std, axis=2)
        error = belief.inertia_std * np.abs(side * limit - belief.omega)
        std = np.sqrt(noise**2 + error**2 + satellite.gyro_noise_std**2)
        return side * np.maximum(limit - self.margin * std, 0.0)

    def _attainable(self, belief: Belief, reference: np.ndarray) -> np.ndarray:
        """The reference as far as the wheels can store the momentum that it leaves to them."""
        axes = self._mission.satellite.wheels.axes
        stored = belief.momentum - _times(belief.inertia, reference)
        change = stored - belief.wheel_momentum @ axes.T
        wheels = belief.wheel_momentum + change @ np.linalg.pinv(axes).T
        excess = stored - np.clip(wheels, -self._wheel_limit, self._wheel_limit) @ axes.T
        return reference + _solve(belief.inertia, excess)


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", matrices, vectors)


def _solve(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.linalg.solve(matrices, vectors[..., None])[..., 0]
