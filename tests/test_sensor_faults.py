"""Faults: what they do to the truth, and what the gated filter makes of the readings they leave."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from baselines.scenarios.flights import Cell, flown
from satid_gym import SCENARIOS, InertiaLaw, SatInertiaIDEnv, SatInertiaIDVectorEnv, Scenario, simulate
from satid_gym.core import kernels
from satid_gym.core.belief.unmeasured import along_axes
from satid_gym.core.random import between, normal, uniform
from satid_gym.estimators import (
    FilterpyAdaptiveEKF,
    FilterpyMomentumEKF,
    FilterpyMomentumUKF,
    FilterpyRateEKF,
    MomentumEKF,
    MomentumEKFSettings,
)
from satid_gym.evaluation import seeds
from satid_gym.faults import FAULTS, SWITCHES
from satid_gym.policies import build, make_baseline
from satid_gym.scenario import prior_of
from tests.cases import cases

GATE = {"name": "momentum", "gate": 1e-6}
RECORDED = json.loads(Path(__file__).with_name("faultless.json").read_text(encoding="utf-8"))


def world(horizon: float = 60.0, **faults) -> Scenario:
    """Scenario "faults" with these faults alone, that begin at a third of the horizon."""
    return SCENARIOS["faults"].replace(
        horizon=horizon, gyro_bias_walk=0.0, faults={"time": (1.0 / 3.0, 1.0 / 3.0), **faults}
    )


def square(t: int, n: int = 3) -> np.ndarray:
    """Open-loop excitation inside the envelope, (n,)."""
    return np.where((t / 30.0 + np.arange(n) / n) % 1.0 < 0.5, 0.1, -0.1)


def fly_truth(env: SatInertiaIDEnv, seed: int = 0):
    """Truth, readings and infos of an open-loop episode at the end of each decision."""
    env.reset(seed=seed)
    rows, infos = [], []
    for t in range(env.problem.scenario.decisions):
        *_, info = env.step(square(t))
        rows.append(env.fleet.rows.plants[0].copy())
        infos.append(info)
    return np.array(rows), infos


# off


@pytest.mark.parametrize("scenario", RECORDED)
def test_without_faults_the_truth_is_what_it_was_before_there_were_any(scenario):
    """The recording was made before faults were written: not one random number more, not one bit of readings."""
    env = SatInertiaIDVectorEnv(6, "random", scenario=scenario)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(30):
        env.step(rng.uniform(-0.2, 0.2, (6, 3)))
    plants = env.state()["plants"]
    recorded = RECORDED[scenario]
    np.testing.assert_array_equal(plants["stream"], np.array(recorded["stream"], np.uint64))
    # other processors round sines and logarithms otherwise
    np.testing.assert_allclose(plants["gyro"], recorded["gyro"], rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(plants["tachometer"], recorded["tachometer"], rtol=1e-9)


# filters


@pytest.mark.compiled
@pytest.mark.parametrize("seed", [64, 72])
@pytest.mark.parametrize("adaptive", [True, False])
def test_gated_filter_equals_filterpy_over_an_episode(seed, adaptive):
    """All faults at once, in the environment: means by their size, covariances by standard deviations.

    Observation and reward are the same as well: they show what the filter accepts of the readings.
    """
    faults = SCENARIOS["faults"].faults.replace(gyro_dropout=1.0, tachometer_stuck=1.0)
    scenario = SCENARIOS["faults"].replace(faults=faults)
    settings, reference = MomentumEKFSettings(adaptive=adaptive, gate=1e-6), FilterpyMomentumEKF
    if adaptive:
        settings, reference = scenario.estimator, FilterpyAdaptiveEKF
    fast = SatInertiaIDEnv(scenario=scenario, inertia="step", estimator=settings)
    slow = SatInertiaIDEnv(scenario=scenario, inertia="step", estimator=reference(gate=1e-6))
    fast.reset(seed=seed)
    slow.reset(seed=seed)
    means, covariances = [], []
    for t in range(300):
        one, other = fast.step(square(t)), slow.step(square(t))
        assert one[4]["nis"] == pytest.approx(other[4]["nis"], rel=1e-6, abs=1e-9)
        np.testing.assert_allclose(one[0], other[0], rtol=1e-6, atol=1e-6, err_msg=f"decision {t}")
        assert one[1] == pytest.approx(other[1], rel=1e-6, abs=1e-9)
        means.append([env.fleet.rows.beliefs["mean"][0].copy() for env in (fast, slow)])
        covariances.append([env.fleet.rows.beliefs["covariance"][0].copy() for env in (fast, slow)])
    mean, covariance = np.array(means), np.array(covariances)
    assert (np.abs(mean[:, 0] - mean[:, 1]) / np.abs(mean).max(axis=(0, 1))).max() < 1e-9
    std = np.sqrt(np.einsum("tii->ti", covariance[:, 0]))
    assert (np.abs(covariance[:, 0] - covariance[:, 1]) / (std[:, :, None] * std[:, None, :])).max() < 1e-9
    assert fast.fleet.rows.reports["rejected"][0] > 0


@pytest.mark.compiled
def test_a_plugged_in_compiled_filter_is_seen_as_the_environments_own():
    scenario = world(gyro_dropout=1.0, gyro_outlier=0.02, tachometer_stuck=1.0)
    own, plugged = (SatInertiaIDEnv(scenario=scenario, estimator=e) for e in (GATE, MomentumEKF(gate=1e-6)))
    own.reset(seed=3)
    plugged.reset(seed=3)
    differs = False
    for t in range(60):
        one, other = own.step(square(t))[0], plugged.step(square(t))[0]
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6, err_msg=f"decision {t}")
        raw = own.fleet.rows.plants["gyro"][0] / own.fleet.rows.tasks["rate_limit"][0]
        differs = differs or bool(np.abs(one[:3] - raw).max() > 0.01)
    assert differs  # from the raw reading, in the dropout


@pytest.mark.compiled
def test_rate_filter_uses_the_tachometers_while_the_gyro_is_flagged():
    """As filterpy's does; the wheels' speeds stay as well known as they were."""
    scenario = world(gyro_dropout=1.0, gyro_dropout_duration=(10.0, 10.0))
    fast, slow = (SatInertiaIDEnv(scenario=scenario, estimator=e) for e in ("rate", FilterpyRateEKF()))
    fast.reset(seed=0)
    slow.reset(seed=0)
    wheels = []
    for t in range(40):
        one, other = fast.step(square(t))[4], slow.step(square(t))[4]
        assert one["nis"] == pytest.approx(other["nis"], rel=1e-6)
        assert one["nis"] > 0.0
        mean = fast.fleet.rows.beliefs["mean"][0]
        np.testing.assert_allclose(mean, slow.fleet.rows.beliefs["mean"][0], rtol=0, atol=1e-9 * np.abs(mean).max())
        wheels.append(np.diag(fast.fleet.rows.beliefs["covariance"][0])[6:].copy())
    assert (wheels[29] <= wheels[19]).all()  # end and beginning of the dropout


@pytest.mark.compiled
def test_single_and_vector_environments_have_the_same_faults():
    envs = SatInertiaIDVectorEnv(40, scenario="faults", num_threads=2)
    observations, _ = envs.reset(seed=5)
    env = SatInertiaIDEnv(scenario="faults")
    for i in (0, 39):
        env.reset(seed=5 + i)
        for name in (
            "gyro_dropout",
            "tachometer_stuck_wheel",
            "tachometer_stuck",
            "wheel_loss_wheel",
            "wheel_loss_start",
            "torque_delay",
            "stream",
        ):
            np.testing.assert_array_equal(env.fleet.rows.plants[name][0], envs.state()["plants"][name][i], err_msg=name)
    env.reset(seed=5 + 39)
    for t in range(200):
        observations, *_, infos = envs.step(np.tile(square(t), (40, 1)))
        observation, *_, info = env.step(square(t))
    np.testing.assert_allclose(observations[39], observation, rtol=1e-6, atol=1e-6)
    assert infos["nees"][39] == pytest.approx(info["nees"], rel=1e-9)
    np.testing.assert_array_equal(infos["faults"][39], info["faults"])
    assert infos["faults"].dtype == bool


def test_same_seed_same_faults_and_another_seed_others():
    starts = []
    for seed in (0, 0, 1):
        env = SatInertiaIDEnv(scenario="faults")
        env.reset(seed=seed)
        starts.append(env.fleet.rows.plants.tobytes())
    assert starts[0] == starts[1] != starts[2]


# what faults do to the truth


def test_a_flagged_dropout_repeats_the_last_reading_and_says_so():
    env = SatInertiaIDEnv(scenario=world(gyro_dropout=1.0, gyro_dropout_duration=(10.0, 10.0)))
    rows, infos = fly_truth(env)
    dropped = np.array([info["faults"][FAULTS.index("gyro_dropout")] for info in infos])
    np.testing.assert_array_equal(np.flatnonzero(dropped) + 1, np.arange(21, 31))  # from 20 s to 30 s
    assert (rows["gyro"][20:30] == rows["gyro"][19]).all()
    assert (rows["gyro"][30] != rows["gyro"][19]).all()
    assert (np.abs(rows["rate"][29] - rows["rate"][19]) > 1e-4).any()  # the body has moved all the while
    np.testing.assert_array_equal(rows["gyro_flagged"], dropped)
    gained = np.array([info["information_gain"] for info in infos])
    assert (gained[dropped] == 0.0).all()
    assert (gained[~dropped][1:] > 0.0).all()


def test_a_silent_dropout_is_not_flagged():
    env = SatInertiaIDEnv(scenario=world(gyro_dropout=1.0, gyro_dropout_silent=1.0))
    rows, infos = fly_truth(env)
    assert any(info["faults"][FAULTS.index("gyro_dropout")] for info in infos)
    assert (rows["gyro_flagged"] == 0).all()


@pytest.mark.compiled
def test_outliers_have_the_size_and_frequency_that_are_asked_for():
    env = SatInertiaIDEnv(scenario=world(100.0, gyro_outlier=0.3, gyro_outlier_size=(100.0, 100.0)))
    rows, _ = fly_truth(env)
    off = (rows["gyro"] - rows["rate"]) / 5e-5  # standard deviations of the microsat's gyro
    spiked = rows["spiked"] == 1
    assert 15 <= spiked.sum() <= 45
    assert (np.abs(off[~spiked]) < 6.0).all()
    largest = np.abs(off[spiked]).max(axis=1)
    np.testing.assert_allclose(largest, 100.0, atol=6.0)
    assert (np.sort(np.abs(off[spiked]), axis=1)[:, 1] < 6.0).all()  # one axis at a time


def test_a_stuck_tachometer_repeats_its_reading_while_the_wheel_turns_on():
    env = SatInertiaIDEnv(scenario=world(tachometer_stuck=1.0, tachometer_stuck_duration=(15.0, 15.0)))
    rows, _ = fly_truth(env)
    wheel = rows["tachometer_stuck_wheel"][0]
    others = [k for k in range(3) if k != wheel]
    assert (rows["tachometer"][20:35, wheel] == rows["tachometer"][19, wheel]).all()
    assert np.ptp(rows["wheel_speed"][20:35, wheel]) > 10.0
    assert (np.abs(rows["tachometer"] - rows["wheel_speed"])[:, others] < 0.3).all()
    assert np.abs(rows["tachometer"] - rows["wheel_speed"])[35:, wheel].max() < 0.3


@cases("loss", [0.4, 1.0])
def test_a_weak_wheel_gives_the_part_of_its_torque_that_it_has_left(loss):
    scenario = world(wheel_loss=1.0, wheel_loss_size=(loss, loss)).replace(torque_noise=0.0)
    rows, infos = fly_truth(SatInertiaIDEnv(scenario=scenario))
    wheel, applied = rows["wheel_loss_wheel"][0], np.array([info["torque_applied"] for info in infos])
    commanded = 0.1 * np.array([square(t) for t in range(60)])
    expected = commanded.copy()
    expected[20:, wheel] *= 1.0 - loss
    np.testing.assert_allclose(applied, expected, rtol=0, atol=1e-9)  # actions are float32


@cases("delay", [1, 3, 10])
def test_commands_come_late_by_whole_samples(delay):
    """Of a decision's ten samples the first `delay` still follow the command before."""
    scenario = world(torque_delay=(delay, delay)).replace(torque_noise=0.0)
    env = SatInertiaIDEnv(scenario=scenario)
    env.reset(seed=0)
    before = np.zeros(3)
    for t in range(12):
        action = np.array([0.1, -0.05, 0.02]) * (1.0 + 0.2 * t) * (-1.0) ** t
        applied = env.step(action)[4]["torque_applied"]
        np.testing.assert_allclose(applied, 0.1 * (delay * before + (10 - delay) * action) / 10, rtol=0, atol=1e-8)
        before = action


def test_the_gyro_starts_with_the_bias_that_is_asked_for():
    envs = SatInertiaIDVectorEnv(2000, scenario=world(gyro_bias_std=2e-5))
    envs.reset(seed=0)
    assert envs.state()["plants"]["gyro_bias"].std() == pytest.approx(2e-5, rel=0.03)


@pytest.mark.compiled
def test_faults_come_as_often_as_their_probabilities_say():
    envs = SatInertiaIDVectorEnv(4000, scenario="faults")
    envs.reset(seed=0)
    plants, faults = envs.state()["plants"], SCENARIOS["faults"].faults
    for happened, probability in (
        (plants["gyro_dropout"][:, 1] > 0.0, faults.gyro_dropout),
        (plants["gyro_dropout_silent"] == 1, faults.gyro_dropout * faults.gyro_dropout_silent),
        (plants["tachometer_stuck_wheel"] >= 0, faults.tachometer_stuck),
        (plants["wheel_loss_wheel"] >= 0, faults.wheel_loss),
        (plants["torque_delay"] == 3, 0.25),
        (plants["tachometer_stuck_wheel"] == 1, faults.tachometer_stuck / 3.0),
    ):
        assert happened.mean() == pytest.approx(probability, abs=4.0 * np.sqrt(0.25 / 4000))


# sample by sample, in a world without noise: what is written out here by hand

TORQUE = np.array([0.02, -0.01, 0.015])  # N m, well within the motors' limit


def quiet(**plant) -> SatInertiaIDEnv:
    """An episode in which faults can happen, no noise hides them and none was drawn; `plant` says which happen."""
    scenario = SCENARIOS["faults"].replace(
        torque_noise=0.0,
        gyro_noise_std=0.0,
        tachometer_noise_std=0.0,
        gyro_bias_walk=0.0,
        faults={"tachometer_stuck": 1e-12, "torque_delay": (0, 3)},
    )
    env = SatInertiaIDEnv(scenario=scenario)
    env.reset(seed=0)
    for name, value in {"torque_delay": 0, **plant}.items():
        env.fleet.rows.plants[name][0] = value
    return env


def sample(env: SatInertiaIDEnv, torque: np.ndarray = TORQUE):
    """The truth after the next tenth of a second, and names of the faults that acted in it."""
    env.fleet.work["torque"][0] = torque
    env.fleet.rows.reports["faults"] = 0
    kernels.sample(env.fleet.rows, env.fleet.work)
    rows = env.fleet.rows
    return rows.plants[0].copy(), [n for n, acted in zip(FAULTS, rows.reports["faults"][0], strict=True) if acted]


@cases("silent", [0, 1])
def test_a_dropout_lasts_from_after_its_first_instant_to_its_last(silent):
    env = quiet(gyro_dropout=[0.2, 0.4], gyro_dropout_silent=silent)
    rows, acted = zip(*(sample(env) for _ in range(5)), strict=True)
    for row, dropped, names in zip(rows, (0, 0, 1, 1, 0), acted, strict=True):
        np.testing.assert_array_equal(row["gyro"], rows[1]["rate"] if dropped else row["rate"])
        assert row["gyro_flagged"] == (dropped and not silent)
        assert names == ["gyro_dropout"] * dropped
    assert np.ptp([row["rate"] for row in rows], axis=0).min() > 0.0


@cases("wheel", [0, 1])
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


@cases("wheel", [0, 2])
def test_a_weak_wheel_is_weak_from_its_moment_on(wheel):
    env = quiet(wheel_loss_start=0.2, wheel_loss_wheel=wheel, wheel_loss_left=0.25)
    for begins in (0.0, 0.1, 0.2, 0.3):
        row, names = sample(env)
        expected = TORQUE.copy()
        if begins >= 0.2:
            expected[wheel] *= 0.25
        assert names == ["wheel_loss"] * (begins >= 0.2)
        np.testing.assert_allclose(row["motor_torque"], expected, rtol=1e-12)


@cases(
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


@cases(("probability", "dropout"), [(0.5, [0.0, 0.0]), (0.0, [0.0, 0.0]), (1.0, [0.5, 1.5])])
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


@cases("delay", [0, 1, 3])
@cases("held", [3, 4])
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


# what the gated filter makes of it

HARD = {
    "gyro_dropout": {"gyro_dropout": 1.0, "gyro_dropout_silent": 0.5},
    "gyro_outlier": {"gyro_outlier": 0.005},
    "tachometer_stuck": {"tachometer_stuck": 1.0},
    "wheel_loss": {"wheel_loss": 1.0},
    "torque_delay": {"torque_delay": (3, 3)},
    "gyro_bias_std": {"gyro_bias_std": 2e-5},
}


@pytest.mark.compiled
@pytest.mark.parametrize("name", [*SWITCHES, "all"])
def test_filter_stays_consistent_and_recovers(name):
    """Mean NEES between 0.1 and 2 from 30 s on, faults and all; error back below 1 % within 20 s after the last."""
    given = HARD[name] if name != "all" else {key: value for part in HARD.values() for key, value in part.items()}
    scenario = world(240.0, **given).replace(gyro_bias_walk=1e-6)
    envs = SatInertiaIDVectorEnv(40, inertia="static", scenario=scenario)
    envs.reset(seed=0)
    nees, error = [], []
    for t in range(240):
        *_, info = envs.step(np.tile(square(t), (40, 1)))
        nees.append(info["nees"])
        error.append(info["relative_error"])
    assert 0.1 < np.mean(nees[30:]) < 2.0
    assert np.mean(nees[160:]) < 2.0  # 80 s + the longest fault, 60 s, + 20 s
    assert np.quantile(error[160], 0.9) < 0.01


@pytest.mark.compiled
def test_without_gate_the_filter_is_certain_of_what_is_wrong():
    """What the gate is for: else a stuck tachometer leaves a NEES of thousands."""
    scenario = world(120.0, tachometer_stuck=1.0)
    worst = {}
    for estimator in ("momentum", GATE):
        envs = SatInertiaIDVectorEnv(20, inertia="static", scenario=scenario, estimator=estimator)
        envs.reset(seed=0)
        nees = [envs.step(np.tile(square(t), (20, 1)))[-1]["nees"] for t in range(60)]
        worst[str(estimator)] = np.mean(nees[45:])
    assert worst["momentum"] > 100.0 * worst[str(GATE)]


@pytest.mark.compiled
def test_a_step_of_inertia_is_not_gated_away():
    """Where all readings are good, the third that is refused is believed."""
    law = {"mode": "step", "size": 0.1, "time": 60.0}
    envs = SatInertiaIDVectorEnv(20, inertia=law, estimator=GATE)
    envs.reset(seed=0)
    nees, rejected = [], []
    for t in range(90):
        *_, info = envs.step(np.tile(square(t), (20, 1)))
        nees.append(info["nees"].mean())
        rejected.append(info["rejected"])
    assert np.mean(nees[65:]) < 2.0
    assert (rejected[-1] - rejected[55]).max() <= 10


@pytest.mark.compiled
@pytest.mark.parametrize("outage", ["tachometer", "gyro", "gyro and tachometer", "tachometer, with panels"])
def test_a_step_that_comes_while_sensors_fail_is_expected(outage):
    """Without a wheel's speed no reading tells of the inertia about its axis, and without the gyro none tells of any.

    Of the axis the filter learned what no reading had told; without a gyro it allows for a step, but takes it for rare.
    """
    faults = {}
    if "tachometer" in outage:
        faults |= {"tachometer_stuck": 1.0, "tachometer_stuck_duration": (60.0, 60.0)}
    if "gyro" in outage:
        faults |= {"gyro_dropout": 1.0, "gyro_dropout_duration": (20.0, 20.0)}
    law = InertiaLaw("step", size=0.1, time=52.0)
    scenario, policy = world(150.0, **faults), build("rate_square", {"period": 12.0, "margin": 3.5})
    if "panels" in outage:
        scenario = SCENARIOS["flex"].replace(horizon=150.0, faults=scenario.faults, estimator=scenario.estimator)
        policy = make_baseline("shaped_square", "microsat", "flex")
    flight = flown(Cell(scenario=scenario, satellite="microsat", inertia=law), policy, seeds("validation", 24))
    print(f"NEES {flight.nees.mean():.2f}, 90 % of the flights below {np.quantile(flight.nees, 0.9):.2f}")
    assert 0.3 < flight.nees.mean() < (50.0 if "gyro" in outage else 2.0)
    assert np.median(flight.error) < 0.001


@pytest.mark.compiled
@cases("stuck", [(1, 0, 0, 0), (1, 1, 0, 0), (0, 1, 1, 1), (1, 1, 1, 1), (2, 0, 0, 2)])
def test_what_is_not_measured_is_what_the_axes_of_stuck_wheels_span(stuck):
    axes = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / np.sqrt(3.0)
    dtype = np.dtype([("axes", float, (3, 4)), ("stuck", np.int64, 4)], align=True)
    (belief,) = np.rec.array([(axes, stuck)], dtype=dtype)
    vector = np.array([0.3, -0.5, 0.8])
    own = axes[:, np.array(stuck) == 1]
    found = along_axes(belief, tuple(vector))
    np.testing.assert_allclose(found, own @ np.linalg.pinv(own) @ vector, rtol=0.0, atol=1e-12)


@pytest.mark.compiled
def test_a_noiseless_gyro_may_repeat_itself():
    """A body at rest: every reading is the same to the bit, and rightly."""
    calm = {"disturbance_scale": 0.0, "gravity_gradient": False, "solar_pressure": 0.0, "torque_noise": 0.0}
    scenario = world().replace(gyro_noise_std=0.0, initial_rate_std=0.0, wheel_speed_range=0.0, **calm)
    for estimator in (GATE, FilterpyMomentumEKF(gate=1e-6)):
        env = SatInertiaIDEnv(inertia="static", scenario=scenario, estimator=estimator)
        env.reset(seed=0)
        for _ in range(3):
            env.step(np.zeros(3))
        assert (env.fleet.rows.plants["gyro"] == 0.0).all()
        assert env.fleet.rows.reports["rejected"][0] == 0
        assert env.fleet.rows.beliefs["coasting"][0] == 0


@cases("accepted", [True, (True,), (True, 5.0), (True, [0.0] * 4), (True, [0.0, 0.0, np.nan])])
def test_what_an_estimator_says_it_accepted_is_checked(accepted):
    class Careless(FilterpyMomentumEKF):
        pass

    Careless.accepted = accepted
    env = SatInertiaIDEnv(estimator=Careless())
    with pytest.raises(ValueError, match="accepted"):
        env.reset(seed=0)


@pytest.mark.compiled
@pytest.mark.parametrize("new", [MomentumEKF, FilterpyMomentumEKF])
def test_a_change_is_dated_by_its_first_rejection_through_an_outage(new, microsat):
    """J steps, a reading is rejected, the gyro is gone for 3 s, another is rejected; the filter stays consistent."""
    speed = 0.5 * microsat.wheels.max_speed * [1.0, -1.0, 1.0]
    flight = simulate(
        microsat, np.zeros((300, 3)), 0.1, omega0=(0.02, -0.03, 0.01), wheel_speed0=speed,
        law=InertiaLaw("step", size=0.1, time=20.0),
    )  # fmt: skip
    rng = np.random.default_rng(0)
    gyro = flight.omega + rng.normal(0.0, 5e-5, flight.omega.shape)
    tachometer = flight.wheel_speed + rng.normal(0.0, 0.1, flight.wheel_speed.shape)
    ekf = new(gate=1e-6)
    ekf.reset(prior_of(microsat, SCENARIOS["default"]), gyro[0], tachometer[0])
    for i in range(1, 233):
        ekf.predict(tachometer[i], 0.1)
        if not 200 < i < 231:
            ekf.update(gyro[i], tachometer[i])
            assert ekf.accepted[0] == (i not in (200, 231)), i
    error = ekf.mean - np.concatenate([flight.momentum[232], np.diag(flight.inertia[232]), np.zeros(3)])
    assert error @ np.linalg.solve(ekf.covariance, error) < chi2.isf(1e-4, 9)


@pytest.mark.compiled
def test_covariance_is_symmetric_to_the_bit_whatever_fails(microsat):
    """Inflated for tilted wheels without tachometer and for a changed inertia, and reinitialised after an outage."""
    wheels = dataclasses.replace(microsat.wheels, axes=Rotation.from_rotvec([0.4, -0.3, 0.5]).as_matrix())
    scenario = world(gyro_dropout=1.0, gyro_outlier=0.3, tachometer_stuck=1.0)
    tilted = microsat.replace(name="tilted", wheels=wheels)
    env = SatInertiaIDEnv(tilted, "step", scenario, estimator={**GATE, "parameters": "full"})
    env.reset(seed=0)
    for t in range(60):
        env.step(square(t))
        covariance = env.fleet.rows.beliefs["covariance"][0]
        np.testing.assert_array_equal(covariance, covariance.T, err_msg=f"decision {t}")
    assert env.fleet.rows.reports["rejected"][0] > 30


@pytest.mark.compiled
def test_a_rejected_outlier_costs_no_reward():
    """What the filter takes for an outlier is no excess of the envelope: the body is at rest here."""
    scenario = world(60.0, gyro_outlier=0.02, gyro_outlier_size=(2000.0, 2000.0)).replace(disturbance_scale=0.0)
    env = SatInertiaIDEnv(scenario=scenario, reward={"held_scale": 0.0})
    env.reset(seed=0)
    rewards = []
    for _ in range(60):
        _, reward, _, _, info = env.step(np.zeros(3))
        rewards.append(reward)
    assert info["rejected"] > 0
    assert min(rewards) == 0.0


def test_truth_of_faults_is_not_in_the_observation():
    """A silent outlier-free, dropout-free world looks the same however its faults will come later."""
    plain, later = world(60.0, tachometer_stuck=1e-12), world(60.0, tachometer_stuck=1.0)
    seen = []
    for scenario in (plain, later):
        env = SatInertiaIDEnv(scenario=scenario.replace(torque_noise=0.0, gyro_noise_std=0.0, tachometer_noise_std=0.0))
        env.reset(seed=0)
        seen.append([env.step(square(t))[0] for t in range(19)])
    np.testing.assert_array_equal(*seen)


# what is refused


@cases(
    ("values", "message"),
    [
        ({"gyro_dropout": 1.5}, "gyro_dropout must be finite and at least 0 and at most 1"),
        ({"gyro_bias_std": -1.0}, "gyro_bias_std must be finite and at least 0"),
        ({"time": (0.5,)}, r"time must be a range \(low, high\)"),
        ({"wheel_loss_size": (0.9, 0.1)}, "with low <= high"),
        ({"torque_delay": (0, 1.5)}, r"torque_delay must be integers \(samples\)"),
        ({"torque_delay": (0, 11)}, "torque_delay must be at most a decision and 1000 samples, here 10"),
        ({"gyro_dropouts": 0.5}, "Did you mean 'gyro_dropout'"),
    ],
)
def test_wrong_settings_are_refused(values, message):
    with pytest.raises(ValueError, match=message):
        Scenario(faults=values)


def test_the_unscented_filter_says_that_it_has_no_gate():
    with pytest.raises(ValueError, match="has neither gate"):
        FilterpyMomentumUKF(gate=1e-6)
