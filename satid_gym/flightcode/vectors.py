"""Test vectors: a flight's readings, some of them lost, and the pilot's result for each."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.fleet import Fleet
from satid_gym.gym_api import seed_stream
from satid_gym.onboard.pilot import Pilot

_GYRO_LOST, _WHEELS_LOST, _REPEATED, _WRONG = 0.02, 0.01, 0.01, 0.01  # share of the readings
_OUTLIER = 0.3  # of the rate limit, and of the angle that a quaternion turns by, rad
Row = tuple[float, np.ndarray, np.ndarray, np.ndarray | None]


def flight(pilot: Pilot, decisions: int) -> list[Row]:
    """Stamps, s, and readings of an episode that the pilot's policy flies; NaN: lost.

    Readings are those of gyro (3,), wheels (n,) and star tracker (4,), None without one. Some of gyro and star
    tracker are wrong where the filter has a gate, and would ruin any other.
    """
    fleet = Fleet(pilot.problem, 1, log=True)
    fleet.rows.plants["stream"][0] = seed_stream(np.random.default_rng(pilot.seed))
    fleet.begin()
    plant, policy = fleet.rows.plants[0], pilot.policy
    seen = plant["tracker"]["reading"].copy() if plant["tracker"]["fresh"] else np.full(4, np.nan)
    tracked, filtered = pilot.mission.prior.sensors.star_tracker is not None, pilot.problem.estimator
    gated = isinstance(filtered, MomentumEKFSettings) and filtered.gate > 0.0
    rows: list[Row] = [(0.0, plant["gyro"].copy(), plant["tachometer"].copy(), seen if tracked else None)]
    policy.reset(pilot.mission, [pilot.seed])
    rng, period = np.random.default_rng([pilot.seed, 1]), pilot.problem.scenario.sample_period
    for _ in range(decisions):
        fleet.step(np.asarray(policy(fleet.rows.observations.copy()), np.float32))
        for sample in fleet.rows.logs[0]:
            gyro, speed = sample["gyro"].copy(), sample["tachometer"].copy()
            time = (len(rows) - int(rng.random() < _REPEATED)) * period
            gyro[:] = np.nan if rng.random() < _GYRO_LOST else gyro
            speed[:] = np.nan if rng.random() < _WHEELS_LOST else speed
            attitude = sample["star_tracker"].copy() if tracked else None
            if gated and rng.random() < _WRONG:
                gyro[rng.integers(3)] += _OUTLIER * pilot.mission.satellite.rate_limit
            if gated and attitude is not None and np.isfinite(attitude).all() and rng.random() < _WRONG:
                turn = Rotation.from_rotvec(_OUTLIER * rng.normal(size=3))
                attitude = (turn * Rotation.from_quat(attitude)).as_quat()
            rows.append((time, gyro, speed, attitude))
    return rows


def expected(pilot: Pilot, rows: Iterable[Row]) -> str:
    """CSV of the readings, and of the torque, N m, the estimate and its standard deviations, kg m^2, after each."""
    n = pilot.problem.wheels
    lines: list[str] = []
    for time, gyro, speed, attitude in rows:
        torque = (pilot.step if lines else pilot.start)(time, gyro, speed, attitude)
        estimate = pilot.estimate
        if not lines:
            names = [*(f"gyro_{axis}" for axis in "xyz"), *(f"wheel_speed_{k}" for k in range(n))]
            names += [] if attitude is None else [f"attitude_{part}" for part in "xyzw"]
            names += [f"torque_{k}" for k in range(n)]
            lines.append(",".join(["time", *names, *estimate.names, *(f"std_{name}" for name in estimate.names)]))
        read = [gyro, speed] if attitude is None else [gyro, speed, attitude]
        values = np.concatenate([[time], *read, torque, estimate.theta, estimate.std])
        lines.append(",".join(map(repr, values.tolist())))
    return "\n".join(lines) + "\n"
