"""Faults of sensors and actuators, sample by sample, in a world without noise: what is written out here by hand."""

from __future__ import annotations

import numpy as np
import pytest

from satid_gym import SCENARIOS, SatInertiaIDEnv
from satid_gym.core import kernels
from satid_gym.core.random import between, normal, uniform
from satid_gym.faults import FAULTS

TORQUE = np.array([0.02, -0.01, 0.015])  # N m, well within the motors' limit


def quiet(**plant) -> SatInertiaIDEnv:
    """An episode in which faults can happen, no noise hides them and none was drawn; `plant` says which happen."""
    scenario = SCENARIOS["faults"].replace(
        torque_noise=0.0,
        gyro_noise_std=0.0,
        tachometer_noise_std=0.0,
        gyro_bias_walk=0.0,
        faults={"tachometer_stuck": 1e-12},
    )
    env = SatInertiaIDEnv(scenario=scenario)
    env.reset(seed=0)
    for name, value in plant.items():
        env.fleet.rows.plants[name][0] = value
    return env


def sample(env: SatInertiaIDEnv, torque: np.ndarray = TORQUE):
    """The truth after the next tenth of a second, and names of the faults that acted in it."""
    env.fleet.work["torque"][0] = torque
    env.fleet.rows.reports["faults"] = 0
    kernels.sample(env.fleet.rows, env.fleet.work)
    rows = env.fleet.rows
    return rows.plants[0].copy(), [n for n, acted in zip(FAULTS, rows.reports["faults"][0], strict=True) if acted]


@pytest.mark.parametrize("silent", [0, 1])
def test_a_dropout_lasts_from_after_its_first_instant_to_its_last(silent):
    env = quiet(gyro_dropout=[0.2, 0.4], gyro_dropout_silent=silent)
    rows, acted = zip(*(sample(env) for _ in range(5)), strict=True)
    for row, dropped, names in zip(rows, (0, 0, 1, 1, 0), acted, strict=True):
        np.testing.assert_array_equal(row["gyro"], rows[1]["rate"] if dropped else row["rate"])
        assert row["gyro_flagged"] == (dropped and not silent)
        assert names == ["gyro_dropout"] * dropped
    assert np.ptp([row["rate"] for row in rows], axis=0).min() > 0.0


@pytest.mark.parametrize("wheel", [0, 1])
def test_a_stuck_tachometer_repeats_the_reading_before(wheel):
    env = quiet(tachometer_stuck=[0.2, 0.4], tachometer_stuck_wheel=wheel)
    rows, acted = zip(*(sample(env) for _ in range(5)), strict=True)
    for row, stuck, names in zip(rows, (0, 0, 1, 1, 0), acted, strict=True):
        expected = row["wheel_speed"].copy()
        if stuck:
            expected[wheel] = rows[1]["wheel_speed"][wheel]
        np.testing.assert_array_equal(row["tachometer"], expected)
        assert names == ["tachometer_stuck"] * stuck
    assert np.ptp([row["wheel_speed"] for row in rows], axis=0).min() > 0.0


@pytest.mark.parametrize("wheel", [0, 2])
def test_a_weak_wheel_is_weak_from_its_moment_on(wheel):
    env = quiet(wheel_loss_start=0.2, wheel_loss_wheel=wheel, wheel_loss_left=0.25)
    for begins in (0.0, 0.1, 0.2, 0.3):
        row, names = sample(env)
        expected = TORQUE.copy()
        if begins >= 0.2:
            expected[wheel] *= 0.25
        assert names == ["wheel_loss"] * (begins >= 0.2)
        np.testing.assert_allclose(row["motor_torque"], expected, rtol=1e-12)


@pytest.mark.parametrize(
    "fault",
    [
        {"gyro_dropout": [0.0, 9.0]},
        {"tachometer_stuck": [0.0, 9.0], "tachometer_stuck_wheel": 0},
        {"wheel_loss_wheel": 0, "wheel_loss_left": 0.0},
    ],
)
def test_nothing_acts_where_no_fault_can_happen(fault):
    row, names = sample(quiet(faulty=0, **fault))
    np.testing.assert_array_equal(row["gyro"], row["rate"])
    np.testing.assert_array_equal(row["tachometer"], row["wheel_speed"])
    np.testing.assert_allclose(row["motor_torque"], TORQUE, rtol=1e-12)
    assert names == []


@pytest.mark.parametrize(("probability", "dropout"), [(0.5, [0.0, 0.0]), (0.0, [0.0, 0.0]), (1.0, [0.5, 1.5])])
def test_outliers_draw_by_draw(probability, dropout):
    """Whether, how large, and where of +x +y +z -x -y -z, after what noise draws; nothing where it cannot be."""
    env = quiet(gyro_outlier=probability, gyro_outlier_size=[0.3, 0.7], gyro_dropout=dropout, gyro_dropout_silent=1)
    stream = env.fleet.rows.plants["stream"][0].copy()
    spikes = 0
    for i in range(30):
        row, names = sample(env)
        for _ in range(3 + 3 + 3 + 3):  # motors, bias, gyro, tachometers
            normal(stream)
        spike = np.zeros(3)
        dropped = dropout[0] < 0.1 * (i + 1) - 1e-9 and 0.1 * (i + 1) <= dropout[1] + 1e-9
        if probability > 0.0 and not dropped and uniform(stream) < probability:
            size, side = between(stream, 0.3, 0.7), int(6.0 * uniform(stream))
            spike[side % 3] = size if side < 3 else -size
            spikes += 1
        if not dropped:
            np.testing.assert_allclose(row["gyro"] - row["rate"], spike, atol=1e-14)
        assert row["spiked"] == spike.any()
        assert names == ["gyro_dropout"] * dropped + ["gyro_outlier"] * bool(spike.any())
        np.testing.assert_array_equal(row["stream"], stream)
    assert (spikes > 5) == (probability > 0.0)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("held", [3, 4])
def test_each_command_is_obeyed_after_its_delay(delay, held):
    """Commands stand for a few samples; some change one wheel alone, and one does not change at all."""
    env = quiet(torque_delay=delay)
    changes = [[0, 0, 1], [0, 0, 2], [0, 0, 2], [3, 0, 2], [3, -1, 2], [-2, 1, -1], [0, 0, 0], [1, 1, 1]]
    commands = np.repeat(0.01 * np.array(changes), held, axis=0)
    obeyed = np.concatenate([np.zeros((delay, 3)), commands])[: len(commands)]
    for command, expected in zip(commands, obeyed, strict=True):
        row, names = sample(env, command)
        np.testing.assert_allclose(row["motor_torque"], expected, rtol=1e-12, atol=1e-18)
        assert names == ["torque_delay"] * (delay > 0)
