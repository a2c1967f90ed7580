"""Test vectors: a flight's readings, some of them lost, and the pilot's result for each."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from satid_gym.fleet import Fleet
from satid_gym.gym_api import seed_stream
from satid_gym.onboard.pilot import Pilot

_GYRO_LOST, _WHEELS_LOST, _REPEATED = 0.02, 0.01, 0.01  # share of the readings
Row = tuple[float, np.ndarray, np.ndarray]


def flight(pilot: Pilot, decisions: int) -> list[Row]:
    """Stamps, s, and readings of gyro (3,) and wheels (n,) of an episode that the pilot's policy flies; NaN: lost."""
    fleet = Fleet(pilot.problem, 1, log=True)
    fleet.rows.plants["stream"][0] = seed_stream(np.random.default_rng(pilot.seed))
    fleet.begin()
    plant, policy = fleet.rows.plants[0], pilot.policy
    rows: list[Row] = [(0.0, plant["gyro"].copy(), plant["tachometer"].copy())]
    policy.reset(pilot.mission, [pilot.seed])
    rng, period = np.random.default_rng([pilot.seed, 1]), pilot.problem.scenario.sample_period
    for _ in range(decisions):
        fleet.step(np.asarray(policy(fleet.rows.observations.copy()), np.float32))
        for sample in fleet.rows.logs[0]:
            gyro, speed = sample["gyro"].copy(), sample["tachometer"].copy()
            time = (len(rows) - int(rng.random() < _REPEATED)) * period
            gyro[:] = np.nan if rng.random() < _GYRO_LOST else gyro
            speed[:] = np.nan if rng.random() < _WHEELS_LOST else speed
            rows.append((time, gyro, speed))
    return rows


def expected(pilot: Pilot, rows: Iterable[Row]) -> str:
    """CSV of the readings, and of the torque, N m, the estimate and its standard deviations, kg m^2, after each."""
    n = pilot.problem.wheels
    lines: list[str] = []
    for time, gyro, speed in rows:
        torque = pilot.step(time, gyro, speed) if lines else pilot.start(time, gyro, speed)
        estimate = pilot.estimate
        if not lines:
            names = [*(f"gyro_{axis}" for axis in "xyz"), *(f"wheel_speed_{k}" for k in range(n))]
            names += [f"torque_{k}" for k in range(n)]
            lines.append(",".join(["time", *names, *estimate.names, *(f"std_{name}" for name in estimate.names)]))
        values = np.concatenate([[time], gyro, speed, torque, estimate.theta, estimate.std])
        lines.append(",".join(map(repr, values.tolist())))
    return "\n".join(lines) + "\n"
