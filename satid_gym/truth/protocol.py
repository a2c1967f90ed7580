"""Protocol of a truth: its inputs and outputs, with units and frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from satid_gym.laws import InertiaLaw
from satid_gym.oscillators import oscillator_count
from satid_gym.satellite import Satellite


@dataclass(frozen=True, eq=False, kw_only=True)
class Episode:
    """Episode as drawn by the environment, from which a truth starts; by default at rest.

    Vectors are in the body frame. A wheel spins about its axis, a column of `satellite.wheels.axes`, by its speed
    relative to the body.

    Attributes:
        satellite: true values, with drawn inertia (kg m^2, oscillators at rest), wheel axes, rotor inertias and
            oscillators; with friction and limits of the scenario.
        law: variation of the inertia from `satellite.inertia`; static unless the truth declares that it follows laws.
        rate: (3,) initial body rate, rad/s.
        wheel_speed: (n,) initial wheel speeds, rad/s.
        attitude: (4,) initial attitude, a quaternion from body to inertial, scalar last.
        deflection: (c,) initial deflection of the oscillators, rad for a panel, m for a slosh mass; the two of a
            mirrored pair follow each other.
        deflection_rate: (c,) its rate, per second.
        sample_period: s for which each torque is held.
        seed: for a truth with its own noise; the same episode has the same seed.
    """

    satellite: Satellite
    law: InertiaLaw = field(default_factory=lambda: InertiaLaw("static"))
    rate: np.ndarray = field(default_factory=lambda: np.zeros(3))
    wheel_speed: np.ndarray = field(default_factory=lambda: np.zeros(0))
    attitude: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    deflection: np.ndarray = field(default_factory=lambda: np.zeros(0))
    deflection_rate: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sample_period: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        for name, count in (
            ("wheel_speed", self.satellite.wheels.count),
            ("deflection", oscillator_count(self.satellite.oscillators)),
            ("deflection_rate", oscillator_count(self.satellite.oscillators)),
        ):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.zeros(count))


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """State of a satellite at an instant, as returned by its truth.

    Attributes:
        rate: (3,) body rate relative to inertial space, body frame, rad/s.
        wheel_speed: (n,) relative to the body, rad/s.
        inertia: (3, 3) kg m^2, body frame, about the centre of mass, wheels locked and oscillators at rest; None: not
            known, then `relative_error`, `nees` and `inertia_true` in info are NaN.
        attitude: (4,) quaternion from body to inertial, scalar last; None: the environment integrates the rate.
        deflection: (c,) of the oscillators, as in `Episode`; required if the satellite has any.
        gyro: (3,) rad/s, a reading in place of the environment's own; None: the environment's sensor reads `rate`.
        tachometer: (n,) rad/s, a reading in place of the environment's own; None: its sensor reads `wheel_speed`.
    """

    rate: np.ndarray
    wheel_speed: np.ndarray
    inertia: np.ndarray | None = None
    attitude: np.ndarray | None = None
    deflection: np.ndarray | None = None
    gyro: np.ndarray | None = None
    tachometer: np.ndarray | None = None


class Truth(Protocol):
    """Simulator, or test bench, that moves the satellite instead of the environment's own truth.

    The environment draws the episode, the motors' noise and faults, sensor noise and disturbance; the truth moves body
    and wheels. A truth with its own satellite ignores what it does not need of `Episode`: its returned state is used.
    `start` raises ValueError for what it cannot simulate.

    A truth with a true attribute `follows_law` varies its inertia by `Episode.law`; without it the environment refuses
    every inertia mode except "static"."""

    def start(self, episode: Episode) -> State:
        """Begin an episode; the state at time 0."""

    def advance(self, torque: np.ndarray, disturbance: np.ndarray, duration: float) -> State:
        """Advance the state at constant torque.

        Args:
            torque: (n,) motor torque on each wheel about its axis, N m, with noise and limits; the body feels -A u.
                Friction of the wheels is the truth's.
            disturbance: (3,) external torque on the satellite, body frame, N m; a truth with its own orbit may ignore
                it.
            duration: s.

        Returns:
            State at the end.
        """
