"""Flights with everything recorded at every sample: truth, readings, and what the filter believed.

The same episodes as `satid_gym.evaluation.fly` for the same seeds. Optionally the truth walks exactly as the
filter's model says: inertia and disturbance torque by random walks, and no gravity gradient, sunlight, orbit
or gyro bias, which that model does not know.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym.bounds import Course
from satid_gym.core import episode
from satid_gym.core.algebra import load_symmetric, store, store_symmetric
from satid_gym.core.dynamics import external_torque, inertia_at, set_speeds
from satid_gym.core.jit import inline, kernel
from satid_gym.estimators.belief import new_work
from satid_gym.estimators.settings import EstimatorSettings, MomentumEKFSettings, brief, disturbance_walk
from satid_gym.faults import Faults
from satid_gym.policy import Policy, includes_covariance, missions
from satid_gym.problem import InertiaLike, Problem, ScenarioLike, problem
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.vector import SatInertiaIDVectorEnv


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """N episodes at T instants, the first of them the start.

    Attributes:
        course: the truth.
        dt: s between two instants.
        attitude: (N, T, 4) quaternion, body to inertial, scalar last.
        gyro, tachometer: (N, T, 3) and (N, T, n) readings, rad/s.
        theta: (N, T, p) estimate, kg m^2.
        covariance: (N, T, p, p) of it, as the filter believed.
        outside: (N,) share of the time outside the rate limit.
        guarded: updates that the filter shortened, in all episodes.
    """

    course: Course
    dt: float
    attitude: np.ndarray
    gyro: np.ndarray
    tachometer: np.ndarray
    theta: np.ndarray
    covariance: np.ndarray
    outside: np.ndarray
    guarded: int


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
) -> Recording:
    """Fly one policy and keep every sample.

    Args:
        policy: what decides; it sees observations alone.
        satellite, inertia, scenario, estimator: as for the environment.
        seeds: one for each episode.
        as_modelled: inertia and disturbance walk as the filter's model says, on top of the inertia law.

    Raises:
        ValueError: `as_modelled` with a filter that has no such model, or that estimates products of inertia.
    """
    posed = problem(satellite, inertia, scenario, estimator, include_covariance=includes_covariance(policy))
    walk = np.zeros(6)
    if as_modelled:
        posed = posed.replace(scenario=model_world(posed.scenario))
        walk = _walk(posed)
    env = SatInertiaIDVectorEnv(
        len(seeds),
        posed.satellites,
        posed.inertia,
        posed.scenario,
        posed.estimator,
        include_covariance=posed.include_covariance,
    )
    (mission,) = missions(posed)
    policy.reset(mission, seeds)
    env.reset(seed=list(seeds))
    state = env.state()
    env.close()
    return _fly(posed, state, policy, walk, seeds)


def _walk(posed: Problem) -> np.ndarray:
    """(6,) std per sqrt(s) of the three moments, kg m^2, and of the disturbance torque, N m."""
    settings = posed.estimator
    if not isinstance(settings, MomentumEKFSettings):
        raise ValueError(f"only the MomentumEKF says how truth walks, got the estimator {settings.name!r}")
    if posed.parameters != "principal":
        raise ValueError("as_modelled walks the three moments alone: fly a satellite without products of inertia")
    satellite = posed.scenario.operate(posed.satellites[0])
    inertia = settings.inertia_walk * np.diag(satellite.inertia)
    torque = disturbance_walk(settings, brief(posed.satellites[0], posed.scenario))
    return np.append(inertia, np.full(3, torque))


def _fly(
    posed: Problem, state: dict[str, np.ndarray], policy: Policy, walk: np.ndarray, seeds: Sequence[int]
) -> Recording:
    world, n = posed.scenario, posed.wheels
    rows, length = len(seeds), world.decisions * world.samples + 1
    p = state["beliefs"]["prior_theta"].shape[1]
    shapes = {"momentum": (3,), "rate": (3,), "wheel_speed": (n,), "inertia": (3, 3), "torque": (3,)}
    shapes |= {"gyro": (3,), "tachometer": (n,), "theta": (p,), "covariance": (p, p), "attitude": (4,)}
    series = {name: np.zeros((rows, length, *shape)) for name, shape in shapes.items()}
    rngs = [np.random.default_rng([seed, 2]) for seed in seeds]
    work, outside = new_work(state["beliefs"]), np.zeros(rows)
    records = tuple(state[name] for name in ("plants", "beliefs", "tasks"))
    records += (work, state["reports"], state["observations"])
    actions = np.zeros((rows, n), np.float32)
    for t in range(-1, world.decisions):
        steps = (
            np.stack([rng.standard_normal((world.samples, 6)) for rng in rngs]) * walk * np.sqrt(world.sample_period)
        )
        if t >= 0:
            actions[:] = policy(state["observations"].copy())
        decide_many(t, actions, steps, *records, *series.values())
        outside += state["reports"]["outside"] if t >= 0 else 0.0
    readings = {name: series.pop(name) for name in ("gyro", "tachometer", "theta", "covariance", "attitude")}
    return Recording(
        course=Course(**series),
        dt=world.sample_period,
        outside=outside / world.decisions,
        guarded=int(state["beliefs"]["guarded"].sum()),
        **readings,
    )


@inline
def _walk_truth(plant, step):
    """Move inertia and disturbance by `step` (6,); momenta stay, so the rate follows."""
    for i in range(3):
        plant.inertia[i, i] += step[i]
        plant.torque_constant[i] += step[3 + i]
    if step[0] != 0.0:
        set_speeds(plant)


@inline
def _note(
    k, plant, belief, momentum, rate, wheel_speed, inertia, torque, gyro, tachometer, theta, covariance, attitude
):  # fmt: skip
    momentum[k], rate[k], wheel_speed[k] = plant.momentum, plant.rate, plant.wheel_speed
    gyro[k], tachometer[k], attitude[k] = plant.gyro, plant.tachometer, plant.attitude
    store_symmetric(inertia[k], inertia_at(plant, plant.time))
    q = plant.attitude
    tensor = load_symmetric(inertia[k])
    store(torque[k], external_torque(plant, plant.time, (q[0], q[1], q[2], q[3]), tensor))
    p = theta.shape[1]
    for a in range(p):
        theta[k, a] = belief.mean[3 + a]
        for b in range(p):
            covariance[k, a, b] = belief.covariance[3 + a, 3 + b]


def _build_decide_many(fingerprint):
    def decide_many(
        decision, actions, steps, plants, beliefs, tasks, work, reports, observations,
        momentum, rate, wheel_speed, inertia, torque, gyro, tachometer, theta, covariance, attitude,
    ):  # fmt: skip
        """One decision of every row with all its samples noted; decision -1 notes the start alone."""
        fingerprint  # noqa: B018
        for i in range(actions.shape[0]):
            plant, belief, task, report = plants[i], beliefs[i], tasks[i], reports[i]
            first = decision * task.samples + 1
            if decision < 0:
                _note(
                    0, plant, belief, momentum[i], rate[i], wheel_speed[i], inertia[i], torque[i], gyro[i],
                    tachometer[i], theta[i], covariance[i], attitude[i],
                )  # fmt: skip
                continue
            episode.command(plant, task, work[0], report, actions[i])
            for s in range(task.samples):
                _walk_truth(plant, steps[i, s])
                episode.sample(plant, task, work[0], report)
                episode.predict(belief, work[0], plant.tachometer, task.sample_period)
                report.nis = episode.take_reading(plant, belief, work[0])
                _note(
                    first + s, plant, belief, momentum[i], rate[i], wheel_speed[i], inertia[i], torque[i], gyro[i],
                    tachometer[i], theta[i], covariance[i], attitude[i],
                )  # fmt: skip
            episode.conclude(plant, belief, task, work[0], report, observations[i])

    return decide_many


decide_many = kernel(_build_decide_many)
