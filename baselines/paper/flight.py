"""Flights of the paper's profiles in the environment, with every reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.paper.world import scenario
from satid_gym.profiles import paper_torque
from satid_gym.satellite import SATELLITES
from satid_gym.vector import SatInertiaIDVectorEnv


@dataclass(frozen=True, eq=False, kw_only=True)
class ProfileFlight:
    """Readings and truth of S episodes of N decisions; body frame, SI units.

    Attributes:
        satellite: its name.
        time: (N + 1,) s.
        gyro: (N + 1, S, 3) reading, rad/s.
        wheel_speed: (N + 1, S, n) reading, rad/s.
        rate: (N + 1, S, 3) true body rate, rad/s.
        inertia: (N + 1, S, 3, 3) true, kg m^2.
        commanded: (N, n) commanded motor torque, N m.
        applied: (N, S, n) mean motor torque of each decision, N m.
        saturated: (N, S, n) whether the wheel was at its speed limit during the decision.
    """

    satellite: str
    time: np.ndarray
    gyro: np.ndarray
    wheel_speed: np.ndarray
    rate: np.ndarray
    inertia: np.ndarray
    commanded: np.ndarray
    applied: np.ndarray
    saturated: np.ndarray

    @property
    def dt(self) -> float:
        """Time between readings, s."""
        return float(self.time[1] - self.time[0])

    @property
    def horizon(self) -> float:
        """Length of the flight, s."""
        return float(self.time[-1])


def fly_profile(satellite: str, mode: str, profile: str, seeds: Sequence[int], horizon: float = 300.0) -> ProfileFlight:
    """Flight of a profile at the paper's amplitude, one episode per seed.

    Raises:
        RuntimeError: an episode ended early, so its record is incomplete.
    """
    world = scenario(horizon)
    env = SatInertiaIDVectorEnv(len(seeds), satellite, mode, world, num_threads=1)
    start = world.decision_period * np.arange(world.decisions)
    commanded = paper_torque(profile, SATELLITES[satellite], start, horizon=horizon)
    actions = commanded / SATELLITES[satellite].wheels.max_torque
    _, info = env.reset(seed=list(seeds))
    plants, inertia = [env.state()["plants"]], [info["inertia_true"]]
    applied, saturated = [], []
    for action in actions:
        _, _, terminated, _, info = env.step(np.broadcast_to(action, (len(seeds), len(action))))
        if terminated.any():
            raise RuntimeError(f"{profile} on {satellite} left the rate limit's margin at {info['time'][0]:g} s")
        plants.append(env.state()["plants"])
        inertia.append(info["inertia_true"])
        applied.append(info["torque_applied"])
        saturated.append(info["saturated"])
    env.close()
    return ProfileFlight(
        satellite=satellite,
        time=world.decision_period * np.arange(world.decisions + 1),
        gyro=np.array([plant["gyro"] for plant in plants]),
        wheel_speed=np.array([plant["tachometer"] for plant in plants]),
        rate=np.array([plant["rate"] for plant in plants]),
        inertia=np.array(inertia),
        commanded=commanded,
        applied=np.array(applied),
        saturated=np.array(saturated),
    )
