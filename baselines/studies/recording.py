"""Flights with everything recorded at every sample: truth, readings, and the filter's estimate.

The same episodes as `satid_gym.evaluation.fly` for the same seeds. Optionally the truth walks exactly as the
filter's model says: inertia and disturbance torque by random walks, and no gravity gradient, sunlight, orbit
or gyro bias, which that model does not know.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from gymnasium.utils import seeding

from satid_gym.bounds import TrueMotion
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.faults import Faults
from satid_gym.fleet import Fleet
from satid_gym.gym_api import seed_stream
from satid_gym.policy import Mission, Policy, missions, observation_settings
from satid_gym.problem import problem
from satid_gym.resolution import InertiaLike, ScenarioLike
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """N episodes at T instants, the first of them the start.

    Attributes:
        motion: the truth.
        dt: s between two instants.
        attitude: (N, T, 4) quaternion, body to inertial, scalar last.
        gyro, tachometer: (N, T, 3) and (N, T, n) readings, rad/s.
        star_tracker: (N, T, 4) readings, as `attitude`; NaN without a reading.
        theta: (N, T, p) estimate, kg m^2.
        covariance: (N, T, p, p) of it, as the filter believed.
        outside: (N,) share of the time outside the rate limit.
        constrained_updates: updates that the filter shortened, in all episodes.
    """

    motion: TrueMotion
    dt: float
    attitude: np.ndarray
    gyro: np.ndarray
    tachometer: np.ndarray
    star_tracker: np.ndarray
    theta: np.ndarray
    covariance: np.ndarray
    outside: np.ndarray
    constrained_updates: int


def model_world(scenario: Scenario) -> Scenario:
    """The scenario without what the filter's model leaves out; the disturbance is its prior's."""
    return scenario.replace(
        gravity_gradient=False, solar_pressure=0.0, orbit_rate=0.0, gyro_bias_walk=0.0, faults=Faults()
    )


def record(
    policy: Policy,
    *,
    satellite: str | Satellite,
    inertia: InertiaLike,
    seeds: Sequence[int],
    scenario: ScenarioLike = "default",
    estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
    as_modelled: bool = False,
    control: str = "torque",
) -> Recording:
    """Fly one policy and keep every sample.

    Args:
        policy: what decides; it sees observations alone.
        satellite, inertia, scenario, estimator, control: as for the environment.
        seeds: one for each episode.
        as_modelled: inertia and disturbance walk as the filter's model says, on top of the inertia law.

    Raises:
        ValueError: `as_modelled` with a filter that has no such model, or that estimates products of inertia.
    """
    posed = problem(satellite, inertia, scenario, estimator, control=control, **observation_settings(policy))
    if as_modelled:
        posed = posed.replace(scenario=model_world(posed.scenario))
    (mission,) = missions(posed)
    fleet = Fleet(posed, len(seeds), num_threads=None, log=True)
    if as_modelled:
        _walk_as_modelled(fleet, mission)
    policy.reset(mission, seeds)
    rows, world = fleet.rows, posed.scenario
    rows.plants["stream"] = [seed_stream(seeding.np_random(int(seed))[0]) for seed in seeds]
    fleet.begin()
    log = np.empty((len(seeds), world.decisions * world.samples + 1), rows.logs.dtype)
    log[:, 0], outside = rows.logs[:, 0], np.zeros(len(seeds))
    for t in range(world.decisions):
        fleet.step(policy(rows.observations.copy()).astype(np.float32))
        log[:, 1 + t * world.samples : 1 + (t + 1) * world.samples] = rows.logs
        outside += rows.reports["outside"]
    fleet.close()
    series = {name: np.ascontiguousarray(log[name]) for name in log.dtype.names or ()}
    return Recording(
        motion=TrueMotion(**{field.name: series[field.name] for field in fields(TrueMotion)}),
        dt=world.sample_period,
        outside=outside / world.decisions,
        constrained_updates=int(rows.beliefs["constrained_updates"].sum()),
        **{name: series[name] for name in ("attitude", "gyro", "tachometer", "star_tracker", "theta", "covariance")},
    )


def _walk_as_modelled(fleet: Fleet, mission: Mission) -> None:
    """Give the truth of a fleet's episodes the random walks of its filter's model."""
    settings = mission.estimator
    if not isinstance(settings, MomentumEKFSettings) or settings.adaptive:
        raise ValueError(
            f"only the MomentumEKF without adaptation says how truth walks, got the estimator {settings.name!r}"
        )
    if settings.parameters != "principal":
        raise ValueError("as_modelled walks the three moments alone: fly a satellite without products of inertia")
    plants = fleet.templates.records.plants
    plants["inertia_walk"] = settings.inertia_walk * np.diag(mission.satellite.inertia)
    plants["torque_walk"] = settings.torque_walk(mission.prior)
