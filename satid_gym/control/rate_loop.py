"""Rate loop: wheel torque that brings the body rates to a command within the envelope, in one decision.

The law is deadbeat (`satid_gym.control.deadbeat`). No law does better against motor noise that is white from decision
to decision: what is left is the noise of one decision. The reference keeps `margin` standard deviations of that noise
away from the rate limit, and the wheels' momentum as far from theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.deadbeat import reach
from satid_gym.control.decoded_observation import Belief, PlantConstants
from satid_gym.core.algebra import axpy_symmetric, inverse, load, load_symmetric, multiply, subtract
from satid_gym.core.control.allocation import storable
from satid_gym.core.jit import inline, kernel
from satid_gym.policy import Mission


class RateLoop:
    """Turns rate commands, as fractions of what the envelope allows, into actions.

    Args:
        missions: the satellites that are flown; all with the same layout and decision period.
        margin: distance of the reference from the rate limit and from the wheel speed limit, in standard
            deviations of what one decision's noise does to them.

    Raises:
        ValueError: the margin is negative, or observations are not of the form "wheels".
    """

    def __init__(self, missions: Sequence[Mission], margin: float) -> None:
        self.margin = check_number("margin", margin)
        self._layout = missions[0].layout
        self._duration = missions[0].scenario.decision_period
        self._all_constants = PlantConstants.of(missions)
        self._constants = self._all_constants.take(np.zeros(1, int))

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._constants = self._all_constants.take(rows)

    def __call__(self, observation: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Action (N, n) for observations (N, size) and rate commands (N, 3) in [-1, 1]."""
        constants = self._constants
        belief = Belief.read(observation, self._layout, constants)
        action = np.empty(belief.wheel_momentum.shape)
        # the kernel does not look whether a row is there
        command = np.ascontiguousarray(np.broadcast_to(command, belief.omega.shape), dtype=float)
        drive_many(belief, command, constants, self.margin, self._duration, action)
        return action


class RateMargin:
    """Turns rate commands, as fractions of what the envelope allows, into actions that are body rates.

    For environments whose rate loop is their own (`core.control.rate_tracking`): the noise it leaves is that of a
    first-order loop, whose rate keeps 1 - k dt of its error from sample to sample.

    Args:
        missions: the satellites that are flown.
        margin: distance of the reference from the rate limit in standard deviations of the body's rate about it: by
            noise, for the prior's inertia, and by the scale of the gyro.

    Raises:
        ValueError: the margin is negative.
    """

    def __init__(self, missions: Sequence[Mission], margin: float) -> None:
        self.margin = check_number("margin", margin)
        self._all_shares = np.array([self._share(mission) for mission in missions])
        self._shares = self._all_shares[:1]

    def _share(self, mission: Mission) -> np.ndarray:
        """(3,) of the rate limit that may be commanded."""
        satellite, world, wheels = mission.satellite, mission.scenario, mission.satellite.wheels
        noise = world.tracking_noise * wheels.max_torque  # N m s
        variance = ((np.linalg.inv(mission.prior.inertia) @ wheels.axes * noise) ** 2).sum(axis=1)
        misread = satellite.tolerances.gyro_scale * satellite.rate_limit
        std = np.sqrt(variance + satellite.gyro_noise_std**2 + misread**2)
        return np.maximum(1.0 - self.margin * std / satellite.rate_limit, 0.0)

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._shares = self._all_shares[rows]

    def __call__(self, observation: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Action (N, 3) for observations (N, size), which it does not look at, and rate commands (N, 3) in [-1, 1]."""
        command = np.broadcast_to(command, (len(observation), 3))
        return np.clip(command, -1.0, 1.0) * self._shares


def rate_loop(missions: Sequence[Mission], margin: float) -> RateLoop | RateMargin:
    """What turns rate commands into the actions of these missions, which are torques or rates.

    Args:
        missions: the satellites that are flown; all with the same layout and control.
        margin: see `RateLoop` and `RateMargin`.

    Raises:
        ValueError: the margin is negative.
    """
    return (RateLoop if missions[0].control == "torque" else RateMargin)(missions, margin)


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


@kernel
def drive_many(beliefs, commands, constants, margin, period, actions):
    """See `RateLoop`: a `Belief` and commands (N, 3), `PlantConstants` of N satellites or one, actions (N, n)."""
    n, all_axes, max_torque = actions.shape[1], constants.axes, constants.max_torque
    wheel, room = np.empty(n), np.empty(n)
    for i in range(actions.shape[0]):
        r = min(i, max_torque.shape[0] - 1)
        axes, allocation, impulse_std = all_axes[r], constants.allocation[r], constants.impulse_std[r]
        omega, momentum = load(beliefs.omega[i]), load(beliefs.momentum[i])
        inertia = load_symmetric(beliefs.inertia[i])
        x, y, z = load(commands[i])
        command = min(max(x, -1.0), 1.0), min(max(y, -1.0), 1.0), min(max(z, -1.0), 1.0)
        limits = (constants.rate_limit[r, 0], constants.gyro_noise_std[r, 0], impulse_std)
        wanted = _reference(command, omega, inertia, beliefs.inertia_std[i], limits, axes, margin)
        for k in range(n):
            wheel[k] = beliefs.wheel_momentum[i, k]
            room[k] = max(constants.max_spin[r, k] - margin * impulse_std[k], 0.0)
        wanted = storable(wanted, momentum, inertia, (axes, allocation, room), wheel)
        J_free = axpy_symmetric(-1.0, load_symmetric(constants.rotor_inertia[r]), inertia)
        state = (momentum, load(beliefs.disturbance[i]))
        wheels = (axes, allocation, max_torque[r])
        reach(omega, wanted, state, (J_free, inverse(J_free)), wheels, period, wheel)
        for k in range(n):
            actions[i, k] = wheel[k] / max_torque[r, k]
