"""Rate loop: wheel torque that brings the body rates to a command within the envelope, in one decision.

The law is deadbeat: the torque that brings the rate to its reference at the end of the decision,

    -A u = (J - A j A^T) (omega_ref - omega) / T + omega_mid x M - tau,    omega_mid = (omega + omega_ref) / 2

from dM/dt = -omega x M + tau and h = j (Omega + A^T omega). No law does better against motor noise that is
white from decision to decision: what is left is the noise of one decision. The reference keeps `margin`
standard deviations of that noise away from the rate limit, and the wheels' momentum as far from theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baselines.belief import Belief, Craft, times
from satid_gym.config import check_number
from satid_gym.policy import Mission


class RateLoop:
    """Turns rate commands, as fractions of what the envelope allows, into actions.

    Args:
        missions: the satellites that are flown; all with the same layout and decision period.
        margin: distance of the reference from the rate limit and from the wheel speed limit, in standard
            deviations of what one decision's noise does to them.

    Raises:
        ValueError: the margin is negative.
    """

    def __init__(self, missions: Sequence[Mission], margin: float) -> None:
        self.margin = check_number("margin", margin)
        self._layout = missions[0].layout
        self._duration = missions[0].scenario.decision_period
        self._crafts = Craft.of(missions)
        self._craft = self._crafts.take(np.zeros(1, int))

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._craft = self._crafts.take(rows)

    def __call__(self, observation: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Action (N, n) for observations (N, size) and rate commands (N, 3) in [-1, 1]."""
        craft, dt = self._craft, self._duration
        belief = Belief.read(observation, self._layout, craft)
        flexibility = np.linalg.inv(belief.inertia)
        reference = self._attainable(belief, flexibility, self._reference(belief, flexibility, command))
        locked = belief.inertia - craft.carried
        loose = np.linalg.inv(locked)
        middle = belief.omega
        for _ in range(2):  # the second time with the rate that the limited torque will reach
            drift = belief.disturbance - _cross(middle, belief.momentum)
            torque = times(locked, reference - belief.omega) / dt - drift
            motor = np.clip(-times(craft.mixer, torque), -craft.max_torque, craft.max_torque)
            middle = belief.omega + 0.5 * dt * times(loose, drift - times(craft.axes, motor))
        return motor / craft.max_torque

    def _reference(self, belief: Belief, flexibility: np.ndarray, command: np.ndarray) -> np.ndarray:
        """(N, 3) rad/s: the command within the limit less the margin for noise and for what J may be."""
        craft = self._craft
        command = np.clip(command, -1.0, 1.0)
        noise = np.sqrt((((flexibility @ craft.axes) * craft.impulse_std[:, None, :]) ** 2).sum(axis=2))
        error = belief.inertia_std * np.abs(command * craft.rate_limit - belief.omega)
        std = np.sqrt(noise**2 + error**2 + craft.gyro_noise_std**2)
        return command * np.maximum(craft.rate_limit - self.margin * std, 0.0)

    def _attainable(self, belief: Belief, flexibility: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """The reference as far as the wheels can store the momentum that it leaves to them."""
        craft = self._craft
        limit = np.maximum(craft.max_spin - self.margin * craft.impulse_std, 0.0)
        stored = belief.momentum - times(belief.inertia, reference)
        change = stored - times(craft.axes, belief.wheel_momentum)
        wheels = np.clip(belief.wheel_momentum + times(craft.mixer, change), -limit, limit)
        return reference + times(flexibility, stored - times(craft.axes, wheels))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row by row a x b; numpy's own costs several times as much for short rows."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
