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

from satid_gym.config import check_number
from satid_gym.control.decoded_observation import Belief, Craft
from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    cross,
    inverse,
    load,
    load_symmetric,
    multiply,
    subtract,
)
from satid_gym.core.dynamics import sum_wheels
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
        build = (craft.axes, craft.mixer, craft.carried)
        action = np.empty(belief.wheel_momentum.shape)
        # the kernel does not look whether a row is there
        command = np.ascontiguousarray(np.broadcast_to(command, belief.omega.shape), dtype=float)
        drive_many(*state, belief.wheel_momentum, command, *limits, *build, self.margin, self._duration, action)
        return action


@inline
def mix(mixer, v, k):
    """Component k of mixer (n, 3) v."""
    return mixer[k, 0] * v[0] + mixer[k, 1] * v[1] + mixer[k, 2] * v[2]


@inline
def _reference(command, omega, flexibility, inertia_std, rate_limit, gyro_noise_std, impulse_std, axes, margin):
    """rad/s: the command within the limit less the margin for noise and for what J may be."""
    v0 = v1 = v2 = gyro_noise_std**2
    for k in range(axes.shape[1]):
        x, y, z = multiply(flexibility, (axes[0, k], axes[1, k], axes[2, k]))
        v0, v1, v2 = v0 + (x * impulse_std[k]) ** 2, v1 + (y * impulse_std[k]) ** 2, v2 + (z * impulse_std[k]) ** 2
    variance = (v0, v1, v2)
    return (
        _within(command[0], omega[0], inertia_std[0], variance[0], rate_limit, margin),
        _within(command[1], omega[1], inertia_std[1], variance[1], rate_limit, margin),
        _within(command[2], omega[2], inertia_std[2], variance[2], rate_limit, margin),
    )


@inline
def _within(command, omega, inertia_std, variance, rate_limit, margin):
    command = min(max(command, -1.0), 1.0)
    slew = inertia_std * (command * rate_limit - omega)
    return command * max(rate_limit - margin * np.sqrt(variance + slew * slew), 0.0)


@inline
def _attainable(reference, momentum, inertia, flexibility, wheel_momentum, max_spin, impulse_std, build, margin, wheel):
    """The reference as far as the wheels can store the momentum that it leaves to them."""
    axes, mixer = build
    stored = subtract(momentum, multiply(inertia, reference))
    change = subtract(stored, sum_wheels(axes, wheel_momentum))
    for k in range(wheel.shape[0]):
        limit = max(max_spin[k] - margin * impulse_std[k], 0.0)
        wheel[k] = min(max(wheel_momentum[k] + mix(mixer, change, k), -limit), limit)
    return add(reference, multiply(flexibility, subtract(stored, sum_wheels(axes, wheel))))


def _build_drive_many(fingerprint):
    def drive_many(
        omegas, momenta, inertias, inertia_stds, disturbances, wheel_momenta, commands,
        rate_limit, gyro_noise_std, max_torque, max_spin, impulse_std, axes, mixer, carried, margin, period, actions,
    ):  # fmt: skip
        """See `RateLoop`; beliefs and commands (N, ...), constants of the satellites (N, ...) or (1, ...)."""
        fingerprint  # noqa: B018
        wheel = np.empty(actions.shape[1])
        for i in range(actions.shape[0]):
            r = min(i, rate_limit.shape[0] - 1)
            omega, momentum, inertia = load(omegas[i]), load(momenta[i]), load_symmetric(inertias[i])
            flexibility = inverse(inertia)
            wanted = _reference(
                commands[i], omega, flexibility, inertia_stds[i], rate_limit[r, 0], gyro_noise_std[r, 0],
                impulse_std[r], axes[r], margin,
            )  # fmt: skip
            wanted = _attainable(
                wanted, momentum, inertia, flexibility, wheel_momenta[i], max_spin[r], impulse_std[r],
                (axes[r], mixer[r]), margin, wheel,
            )  # fmt: skip
            loose = axpy_symmetric(-1.0, load_symmetric(carried[r]), inertia)
            needed = multiply(loose, subtract(wanted, omega))
            middle = omega
            for _ in range(2):  # the second time with the rate that the limited torque will reach
                drift = add(load(disturbances[i]), cross(momentum, middle))
                torque = axpy(1.0 / period, needed, (-drift[0], -drift[1], -drift[2]))
                for k in range(wheel.shape[0]):
                    wheel[k] = min(max(-mix(mixer[r], torque, k), -max_torque[r, k]), max_torque[r, k])
                gained = multiply(inverse(loose), subtract(drift, sum_wheels(axes[r], wheel)))
                middle = axpy(0.5 * period, gained, omega)
            for k in range(wheel.shape[0]):
                actions[i, k] = wheel[k] / max_torque[r, k]

    return drive_many


drive_many = kernel(_build_drive_many)
