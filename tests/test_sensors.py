"""Sensors and motors, draw by draw: what a reading is made of, and what a motor makes of a command."""

from __future__ import annotations

import numpy as np
from scipy.stats import kstest

from satid_gym import SatInertiaIDEnv
from satid_gym.core import kernels
from satid_gym.core.random import normal
from tests.cases import cases

DT = 0.1


def noisy(lag: float) -> SatInertiaIDEnv:
    """Every noise on, each of another size; the gyro's bias walks by as much as it reads."""
    env = SatInertiaIDEnv(
        scenario={
            "torque_noise": 0.3,
            "torque_lag": lag,
            "gyro_noise_std": 2e-3,
            "gyro_bias_walk": 5e-3,
            "tachometer_noise_std": 3.0,
        }
    )
    env.reset(seed=1)
    return env


@cases("lag", [0.0, 0.25])
def test_a_sample_draw_by_draw(lag):
    """Motors first, then the gyro's bias, then the readings, each with the next deviates of the stream."""
    env = noisy(lag)
    plant, limit = env.fleet.rows.plants[0], env.fleet.rows.plants["torque_max"][0]
    command = limit * [0.5, -0.9, 0.9]
    env.fleet.work["torque"][0] = command
    stream, cut = plant["stream"].copy(), 0

    def deviates(count):
        return np.array([normal(stream) for _ in range(count)])

    for _ in range(8):
        torque, bias = plant["motor_torque"].copy(), plant["gyro_bias"].copy()
        kernels.sample(env.fleet.rows, env.fleet.work)
        wanted = command + 0.3 * limit * deviates(3)
        cut += (np.abs(wanted) > limit).sum()
        torque += DT / (lag + DT) * (np.clip(wanted, -limit, limit) - torque)
        bias += 5e-3 * np.sqrt(DT) * deviates(3)
        np.testing.assert_allclose(plant["motor_torque"], torque, rtol=1e-12)
        np.testing.assert_allclose(plant["gyro_bias"], bias, rtol=1e-12)
        np.testing.assert_allclose(plant["gyro"], plant["rate"] + bias + 2e-3 * deviates(3), rtol=1e-12)
        np.testing.assert_allclose(plant["tachometer"], plant["wheel_speed"] + 3.0 * deviates(3), rtol=1e-12)
    assert cut > 1, "noise takes some commands past the limit"
    np.testing.assert_array_equal(plant["stream"], stream)


def test_the_motor_torque_is_what_turns_the_wheels():
    """Without lag a sample changes a wheel's absolute spin by the motor's torque times the period."""
    env = noisy(0.0)
    plant = env.fleet.rows.plants[0]
    env.fleet.work["torque"][0] = 0.05 * plant["torque_max"]
    before = plant["wheel_momentum"].copy()
    kernels.sample(env.fleet.rows, env.fleet.work)
    np.testing.assert_allclose(plant["wheel_momentum"] - before, DT * plant["motor_torque"], rtol=1e-9)


def test_walks_of_the_studies_have_the_size_that_is_asked_for():
    """Steps of disturbance torque and moments, normal with variance in proportion to time; none unless asked for."""
    env = SatInertiaIDEnv(scenario={"torque_noise": 0.0})
    env.reset(seed=2)
    plants = env.fleet.rows.plants
    torque, moments = plants["torque_constant"][0].copy(), np.diag(plants["inertia"][0]).copy()
    kernels.sample(env.fleet.rows, env.fleet.work)
    np.testing.assert_array_equal(plants["torque_constant"][0], torque)
    np.testing.assert_array_equal(np.diag(plants["inertia"][0]), moments)
    size = np.array([1e-3, 2e-3, 3e-3])
    plants["torque_walk"], plants["inertia_walk"] = 2e-6, size
    seen = [(torque, moments)]
    for _ in range(300):
        kernels.sample(env.fleet.rows, env.fleet.work)
        plant = plants[0]
        seen.append((plant["torque_constant"].copy(), np.diag(plant["inertia"]).copy()))
        spin = plant["axes"] @ (plant["wheel_inertia"] * plant["wheel_speed"])
        np.testing.assert_allclose(plant["momentum"], plant["inertia"] @ plant["rate"] + spin, rtol=1e-9, atol=1e-12)
    for path, std in zip(map(np.array, zip(*seen, strict=True)), (2e-6, size), strict=True):
        steps = np.diff(path, axis=0) / (std * np.sqrt(DT))
        assert kstest(steps.ravel(), "norm").pvalue > 1e-5
