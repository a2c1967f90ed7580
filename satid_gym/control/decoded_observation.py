"""Observation decoded to physical units, for episodes of one satellite or of several."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from satid_gym.core.observation import observed_std
from satid_gym.estimators.inertia import PRODUCTS
from satid_gym.policy import Mission


class PlantConstants(NamedTuple):
    """Constants of the satellites that R episodes fly, or of the one that all of them fly (R = 1).

    Attributes:
        rate_limit, disturbance_std, gyro_noise_std: (R, 1) of the satellite.
        wheel_inertia, max_torque, max_spin: (R, n) of the wheels; max_spin = j times the speed limit, N m s.
        impulse_std: (R, n) std of what motor torque noise does to a wheel in one decision, N m s.
        axes: (R, 3, n) wheel axes.
        allocation: (R, n, 3) pseudo-inverse of the axes.
        rotor_inertia: (R, 3, 3) A j A^T, kg m^2.
        prior: (R, 3, 3) mean of the filter's prior, kg m^2.
    """

    rate_limit: np.ndarray
    disturbance_std: np.ndarray
    gyro_noise_std: np.ndarray
    wheel_inertia: np.ndarray
    max_torque: np.ndarray
    max_spin: np.ndarray
    impulse_std: np.ndarray
    axes: np.ndarray
    allocation: np.ndarray
    rotor_inertia: np.ndarray
    prior: np.ndarray

    @classmethod
    def of(cls, missions: Sequence[Mission]) -> Self:
        """One row a mission.

        Raises:
            ValueError: a mission's observations are of the form "body", which does not hold the wheels' speeds.
        """
        if any(m.observation != "wheels" for m in missions):
            raise ValueError(
                'the rate loop and planners need the speed of each wheel, which observation="body" leaves out: give '
                'observation="wheels"'
            )
        satellites = [m.satellite for m in missions]
        wheels = [s.wheels for s in satellites]
        worlds = [m.scenario for m in missions]
        impulse = [w.torque_noise * w.sample_period * np.sqrt(w.samples) for w in worlds]
        return cls(
            rate_limit=np.array([[s.rate_limit] for s in satellites]),
            disturbance_std=np.array([[s.disturbance_std] for s in satellites]),
            gyro_noise_std=np.array([[s.gyro_noise_std] for s in satellites]),
            wheel_inertia=np.array([w.inertia for w in wheels]),
            max_torque=np.array([w.max_torque for w in wheels]),
            max_spin=np.array([w.max_momentum for w in wheels]),
            impulse_std=np.array([k * w.max_torque for k, w in zip(impulse, wheels, strict=True)]),
            axes=np.array([w.axes for w in wheels]),
            allocation=np.array([np.linalg.pinv(w.axes) for w in wheels]),
            rotor_inertia=np.array([w.rotor_inertia for w in wheels]),
            prior=np.array([m.prior.inertia for m in missions]),
        )

    def take(self, rows: np.ndarray) -> Self:
        """The constants of the missions `rows` (N,)."""
        return type(self)(*(values[rows] for values in self))


class Belief(NamedTuple):
    """What N episodes measure and believe, body frame.

    Attributes:
        omega: (N, 3) measured body rate, rad/s.
        wheel_momentum: (N, n) j Omega of each wheel, N m s.
        inertia: (N, 3, 3) estimated, kg m^2.
        inertia_std: (N, p) standard deviation of the moments, relative to their prior, and of the products, relative to
            the geometric mean of the moments' priors.
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
    def read(cls, observation: np.ndarray, layout: dict[str, slice], constants: PlantConstants) -> Self:
        """From observations (N, size) and what was known before the flight.

        Raises:
            ValueError: an observation is not finite; see `check_observation`.
        """
        check_observation(observation, layout)
        part = {name: observation[:, place].astype(float) for name, place in layout.items()}
        omega = part["rate"] * constants.rate_limit
        wheel_momentum = part["wheel_speed"] * constants.max_spin
        inertia = observed_inertia(part["inertia"], constants.prior)
        return cls(
            omega=omega,
            wheel_momentum=wheel_momentum,
            inertia=inertia,
            inertia_std=observed_std(part["uncertainty"]),
            momentum=times(inertia, omega) + times(constants.axes, wheel_momentum),
            disturbance=part["disturbance"] * constants.disturbance_std,
        )


def check_observation(observation: np.ndarray, layout: dict[str, slice]) -> None:
    """Refuse observations that a policy would turn into torque that is not finite.

    Args:
        observation: (N, size), one row an episode.
        layout: places of its parts by name.

    Raises:
        ValueError: there is no row for each episode, or a number is not finite; the message says in which rows and
            parts.
    """
    if observation.ndim != 2:
        raise ValueError(
            f"policies take observations (N, size), one row an episode, got shape {observation.shape}; "
            "for a single environment give observation[None] and take row 0 of the action"
        )
    finite = np.isfinite(observation)
    if finite.all():
        return
    rows = np.flatnonzero(~finite.all(axis=1)).tolist()
    parts = [name for name, place in layout.items() if not finite[:, place].all()] or ["what the layout does not name"]
    raise ValueError(
        f"the observation must be finite; episode rows {rows} are not, in {', '.join(parts)}: look at what changes "
        "observations between environment and policy (the environment itself gives finite ones alone), and reset "
        "these episodes"
    )


def times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Row by row, matrix times vector."""
    return (matrices @ vectors[..., None])[..., 0]


def observed_inertia(change: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Tensors (N, 3, 3) from changes (N, p) of the parameters, relative to the scales of the observation."""
    inertia = np.zeros((len(change), 3, 3))
    for i in range(3):
        inertia[:, i, i] = prior[:, i, i] * (1.0 + change[:, i])
    for k, (i, j) in enumerate(PRODUCTS[: change.shape[1] - 3]):
        product = prior[:, i, j] + np.sqrt(prior[:, i, i] * prior[:, j, j]) * change[:, 3 + k]
        inertia[:, i, j] = inertia[:, j, i] = product
    return inertia
