"""Rate loop: wheel torque that brings the body rates to a command within the envelope, in one decision.

The law is deadbeat (`satid_gym.control.deadbeat`). No law does better against motor noise that is white from decision
to decision: what is left is the noise of one decision. The reference keeps `margin` standard deviations of that noise
away from the rate limit, and the wheels' momentum as far from theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.deadbeat import reach, storable
from satid_gym.control.decoded_observation import Belief, Craft
from satid_gym.core.algebra import axpy_symmetric, inverse, load, load_symmetric, multiply, subtract
from satid_gym.core.jit import inline, kernel
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
        craft = self._craft
        belief = Belief.read(observation, self._layout, craft)
        state = (belief.omega, belief.momentum, belief.inertia, belief.inertia_std, belief.disturbance)
        limits = (craft.rate_limit, craft.gyro_noise_std, craft.max_torque, craft.max_spin, craft.impulse_std)
        build = (craft.axes, craft.allocation, craft.rotor_inertia)
        action = np.empty(belief.wheel_momentum.shape)
        # the kernel does not look whether a row is there
        command = np.ascontiguousarray(np.broadcast_to(command, belief.omega.shape), dtype=float)
        drive_many(*state, belief.wheel_momentum, command, *limits, *build, self.margin, self._duration, action)
        return action


@inline
def _reference(command, omega, inertia, inertia_std, limits, axes, margin):
    """rad/s: the command within the limit less the margin for noise and for what J may be."""
    rate_limit, gyro_noise_std, impulse_std = limits
    J_inv = inverse(inertia)
    v0 = v1 = v2 = gyro_noise_std**2
    for k in range(axes.shape[1]):
        x, y, z = multiply(J_inv, (axes[0, k], axes[1, k], axes[2, k]))
        v0, v1, v2 = v0 + (x * impulse_std[k]) ** 2, v1 + (y * impulse_std[k]) ** 2, v2 + (z * impulse_std[k]) ** 2
    x, y, z = command
    slew = subtract((x * rate_limit, y * rate_limit, z * rate_limit), omega)
    a, b, c = slew[0] ** 2, slew[1] ** 2, slew[2] ** 2
    v0, v1, v2 = v0 + inertia_std[0] ** 2 * a, v1 + inertia_std[1] ** 2 * b, v2 + inertia_std[2] ** 2 * c
    if inertia_std.shape[0] > 3:  # products: a slew about one axis turns the others too
        xx, yy, zz = inertia[0], inertia[1], inertia[2]
        xy, xz, yz = inertia_std[3] ** 2, inertia_std[4] ** 2, inertia_std[5] ** 2
        v0 += xy * b * yy / xx + xz * c * zz / xx
        v1 += xy * a * xx / yy + yz * c * zz / yy
        v2 += xz * a * xx / zz + yz * b * yy / zz
    return (
        x * max(rate_limit - margin * np.sqrt(v0), 0.0),
        y * max(rate_limit - margin * np.sqrt(v1), 0.0),
        z * max(rate_limit - margin * np.sqrt(v2), 0.0),
    )


def _build_drive_many(fingerprint):
    def drive_many(
        omegas, momenta, inertias, inertia_stds, disturbances, wheel_momenta, commands,
        rate_limit, gyro_noise_std, max_torque, max_spin, impulse_std, axes, allocation, rotors, margin, period,
        actions,
    ):  # fmt: skip
        """See `RateLoop`; beliefs and commands (N, ...), constants of the satellites (N, ...) or (1, ...)."""
        fingerprint  # noqa: B018
        n = actions.shape[1]
        wheel, scratch, room = np.empty(n), np.empty(n), np.empty(n)
        for i in range(actions.shape[0]):
            r = min(i, rate_limit.shape[0] - 1)
            omega, momentum, inertia = load(omegas[i]), load(momenta[i]), load_symmetric(inertias[i])
            x, y, z = load(commands[i])
            command = min(max(x, -1.0), 1.0), min(max(y, -1.0), 1.0), min(max(z, -1.0), 1.0)
            limits = (rate_limit[r, 0], gyro_noise_std[r, 0], impulse_std[r])
            wanted = _reference(command, omega, inertia, inertia_stds[i], limits, axes[r], margin)
            for k in range(n):
                wheel[k] = wheel_momenta[i, k]
                room[k] = max(max_spin[r, k] - margin * impulse_std[r, k], 0.0)
            wanted = storable(wanted, momentum, inertia, (axes[r], allocation[r], room), wheel, scratch)
            free = axpy_symmetric(-1.0, load_symmetric(rotors[r]), inertia)
            state = (momentum, load(disturbances[i]))
            wheels = (axes[r], allocation[r], max_torque[r])
            reach(omega, wanted, state, (free, inverse(free)), wheels, period, wheel, scratch)
            for k in range(n):
                actions[i, k] = wheel[k] / max_torque[r, k]

    return drive_many


drive_many = kernel(_build_drive_many)
