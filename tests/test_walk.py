"""The AdaptiveEKF: what walk it finds, what that is worth, and that it is one filter in every shell.

Its algebra is compared with filterpy's in test_filters and test_env.
"""

from __future__ import annotations

import numpy as np
import pytest
from test_consistency import fly as fly_cell
from test_consistency import square_wave
from test_filters import DT, assert_equal_filters, fly, run_slowly

from baselines.studies.recording import record
from satid_gym import InertiaLaw, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.estimators import (
    AdaptiveEKF,
    FilterpyAdaptiveEKF,
    MomentumEKF,
    MomentumEKFSettings,
    RateEKF,
    estimator_settings,
)
from satid_gym.evaluation import fly as fly_policy
from satid_gym.evaluation import seeds
from satid_gym.gym_api import INFO_KEYS
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import final_error
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policy import missions
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES
from satid_gym.scenario import prior_of
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases

SECOND = round(1.0 / DT)


def walks(ekf: AdaptiveEKF, readings) -> tuple[np.ndarray, np.ndarray]:
    """(N - 1,) the walk that each prediction took and the steps found after each update."""
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    series = []
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        ekf.predict(speed, DT)
        ekf.update(gyro, speed)
        series.append((ekf.inertia_walk, ekf.steps))
    return tuple(np.array(series).T)


@pytest.mark.parametrize(
    "settings",
    [
        {"log_q_drift": 1.0},
        {"inertia_walk_min": 0.01, "parameters": "full"},
        {"inertia_walk": 0.0, "inertia_walk_min": 0.001},
    ],
)
@pytest.mark.parametrize("mode", ["static", "step"])
def test_a_short_flight_is_filterpys(settings, mode, microsat):
    """With walks that change often, from far above the least one and from below it."""
    readings = fly(microsat, mode, seconds=40)
    run = AdaptiveEKF(**settings).run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    assert_equal_filters(run, run_slowly(FilterpyAdaptiveEKF(**settings), readings), 1e-8)


def test_steps_are_found_as_filterpys(microsat):
    """Three changes of the body, the second too soon after the first: the walk alone follows it, at its fastest."""
    readings = fly(microsat, "static", seconds=60)
    time = DT * np.arange(len(readings.gyro))
    factor = np.select([time < 10.0, time < 25.0, time < 45.0], [1.0, 0.95, 1.05], 0.93)
    readings.gyro[:] = factor[:, None] * readings.gyro
    ekf, reference = AdaptiveEKF(), FilterpyAdaptiveEKF()
    found, fastest = [], 0.0
    for filter in (ekf, reference):
        filter.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    for gyro, speed, at in zip(readings.gyro[1:], readings.wheel_speed[1:], time[1:], strict=True):
        before = ekf.steps
        for filter in (ekf, reference):
            filter.predict(speed, DT)
            filter.update(gyro, speed)
        found += [at] if ekf.steps > before else []
        fastest = max(fastest, ekf.inertia_walk)
        assert ekf.steps == reference.steps
        np.testing.assert_allclose(ekf.mean, reference.mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(ekf.covariance, reference.covariance, rtol=1e-7, atol=1e-13)
    assert len(found) == 2
    np.testing.assert_allclose(found, [10.0, 45.0], atol=1.0)
    assert fastest == pytest.approx(0.02)


@pytest.mark.compiled
def test_its_derivatives_are_those_of_filters_of_nearby_walks(microsat):
    """What is left out, that theta's error is M's as well, is a fifth of the covariance's derivative."""
    readings, walk, apart = fly(microsat, "drift"), 0.001, 1e-3
    more, less = (
        MomentumEKF(inertia_walk=walk * np.exp(0.5 * sign * apart)).run(
            readings.prior, readings.gyro, readings.wheel_speed, DT
        )
        for sign in (1.0, -1.0)
    )
    theta = (more.inertia - less.inertia) / (2.0 * apart)
    covariance = (more.inertia_covariance - less.inertia_covariance) / (2.0 * apart)
    ekf = AdaptiveEKF(inertia_walk=walk)
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    parameter = ekf.record["adaptation"]["log_q"].copy()
    own = []
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        ekf.predict(speed, DT)
        ekf.update(gyro, speed)
        ekf.record["adaptation"]["log_q"] = parameter
        row = ekf.record["adaptation"]
        own.append(np.concatenate([row["theta_slope"], np.diag(row["covariance_slope"])]))
    settled = slice(60 * SECOND, None)
    for k in range(3):
        mine = np.array(own)[settled]
        assert np.corrcoef(mine[:, k], theta[1:][settled, k])[0, 1] > 0.8
        assert 0.8 < np.median(mine[:, 3 + k] / covariance[1:][settled, k, k]) < 1.3


@pytest.mark.compiled
@pytest.mark.parametrize("walk", [0.0006, 0.002, 0.006])
def test_it_finds_the_walk_of_a_truth_that_walks(walk):
    """The inertia walks as the MomentumEKF of that walk says; neither filter decided the excitation."""
    flights = record(
        RateSquarePolicy(period=30.0, margin=3.0),
        satellite="microsat",
        inertia="static",
        seeds=range(8),
        estimator={"name": "momentum", "inertia_walk": walk},
        as_modelled=True,
    )
    prior, found = prior_of(SATELLITES["microsat"], SCENARIOS["default"]), []
    for gyro, speed in zip(flights.gyro, flights.tachometer, strict=True):
        ekf = AdaptiveEKF()
        ekf.reset(prior, gyro[0], speed[0])
        for i in range(1, len(gyro)):
            ekf.predict(speed[i], DT)
            ekf.update(gyro[i], speed[i])
            found.append(ekf.inertia_walk if i > 60 * SECOND else np.nan)
    assert 0.8 * walk < np.nanmedian(found) < 1.25 * walk


@pytest.mark.compiled
def test_it_finds_what_holds(microsat):
    """Static: hardly a walk; periodic: a fast one; a step: once, within a second, and the walk it had before."""
    static, periodic, step = (walks(AdaptiveEKF(), fly(microsat, mode)) for mode in ("static", "periodic", "step"))
    assert static[0][-60 * SECOND :].max() < 1e-4
    assert 1e-3 < np.median(periodic[0][-60 * SECOND :]) < 1e-2
    assert static[1][-1] == periodic[1][-1] == 0
    at = 150 * SECOND
    assert step[1][at - SECOND] == 0
    assert step[1][at + SECOND] == step[1][-1] == 1
    assert step[0][-60 * SECOND :].max() < 2e-4


def test_a_wild_reading_is_guarded_and_counted_once(microsat):
    ekf = AdaptiveEKF()
    ekf.reset(prior_of(microsat, SCENARIOS["default"]), (0.02, 0.02, 0.02), (50.0, -50.0, 50.0))
    ekf.predict((-150.0, -250.0, -150.0), DT)
    assert ekf.constrained_updates == 0
    ekf.update((30.0, -30.0, 30.0), (-150.0, -250.0, -150.0))
    assert ekf.constrained_updates == 1


def test_a_reading_that_no_walk_explains_is_taken_in_with_theta_uncertain_again(microsat):
    readings = fly(microsat, "static", seconds=60)
    ekf = AdaptiveEKF()
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        ekf.predict(speed, DT)
        ekf.update(gyro, speed)
    known = np.sqrt(np.diag(ekf.covariance))[3:6] / ekf.mean[3:6]
    assert (known < 0.002).all()
    ekf.predict(speed, DT)
    assert np.abs(gyro).max() > 0.005
    nis = ekf.update(0.92 * gyro, speed)  # as of a body with more inertia
    assert ekf.steps == 1
    assert nis < 5.0
    unsure = np.sqrt(np.diag(ekf.covariance))[3:6] / ekf.mean[3:6]
    assert (unsure > 5.0 * known).all()


@pytest.fixture(scope="module")
def cells() -> dict:
    """Default scenario, 50 episodes a cell: (MomentumEKF, AdaptiveEKF)."""
    return {
        (s, mode): tuple(
            fly_cell(square_wave, s, mode, estimator=name, episodes=50) for name in ("momentum", "adaptive")
        )
        for s in BENCHMARK_SATELLITES
        for mode in INERTIA_MODES
    }


@pytest.mark.parametrize("mode", INERTIA_MODES)
@pytest.mark.parametrize("satellite", BENCHMARK_SATELLITES)
@pytest.mark.compiled
def test_it_is_consistent_and_no_worse_than_a_fixed_walk(satellite, mode, cells):
    fixed, adaptive = cells[satellite, mode]
    assert 0.2 < adaptive.nees[adaptive.settled].mean() < 2.0
    gained = final_error(adaptive.error).mean() / final_error(fixed.error).mean()
    assert gained < {"static": 0.25, "step": 0.25, "drift": 0.95, "periodic": 1.1}[mode]


@pytest.mark.compiled
def test_a_step_is_known_for_one(cells):
    """Right after a step the fixed walk is sure of what is wrong; the adaptive filter has noticed."""
    fixed, adaptive = cells["microsat", "step"]
    steps = np.abs(np.diff(fixed.scale, axis=0)).argmax(axis=0)
    after = {
        name: np.median([flights.nees[t + 1, i] for i, t in enumerate(steps)])
        for name, flights in (("fixed", fixed), ("adaptive", adaptive))
    }
    assert after["adaptive"] < 0.2 * after["fixed"]


@pytest.mark.parametrize("mode", ["step", "periodic"])
def test_a_vector_of_them_is_the_single_one(mode):
    settings = {"inertia": mode, "estimator": "adaptive", "include_covariance": True, "max_episode_steps": 25}
    vector = SatInertiaIDVectorEnv(3, "random", **settings, num_threads=1)
    observations, _ = vector.reset(seed=7)
    singles = [SatInertiaIDEnv("random", **settings) for _ in range(3)]
    for i, env in enumerate(singles):
        np.testing.assert_array_equal(env.reset(seed=7 + i)[0], observations[i])
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (25, 3, 3)).astype(np.float32)
    for action in actions:
        observations, rewards, _, _, infos = vector.step(action)
        for i, env in enumerate(singles):
            observation, reward, _, _, info = env.step(action[i])
            np.testing.assert_array_equal(observation, observations[i])
            assert reward == rewards[i]
            for key in set(INFO_KEYS) - {"costs"}:
                np.testing.assert_array_equal(info[key], infos[key][i])


def test_a_state_restored_goes_on_alike():
    env = SatInertiaIDVectorEnv(2, estimator="adaptive")
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (40, 2, 3)).astype(np.float32)
    for action in actions[:20]:
        env.step(action)
    state = env.state()
    first = [env.step(action)[0] for action in actions[20:]]
    env.restore(state)
    for action, expected in zip(actions[20:], first, strict=True):
        np.testing.assert_array_equal(env.step(action)[0], expected)


BLIND = {
    "name": "faults",
    "faults": {"time": (0.1, 0.1), "gyro_dropout": 1.0, "gyro_dropout_silent": 0.0, "gyro_dropout_duration": (40, 40)},
}  # from 30 s to 70 s the gyro says that it has no reading


def test_without_a_gyro_reading_it_predicts_alone():
    """Its uncertainty grows, that of the walk too, and the walk stays."""
    env = SatInertiaIDEnv(inertia="periodic", scenario=BLIND, estimator={"name": "adaptive", "log_q_drift": 0.01})
    env.reset(seed=0)
    part = env.layout["uncertainty"]
    rng = np.random.default_rng(0)
    spread, variance, parameter = [], [], []
    for _ in range(75):
        observation, *_ = env.step(rng.uniform(-0.2, 0.2, 3).astype(np.float32))
        spread.append(observation[part])
        variance.append(env.fleet.rows.beliefs["adaptation"]["log_q_variance"][0])
        parameter.append(env.fleet.rows.beliefs["adaptation"]["log_q"][0])
    blind = slice(31, 69)
    assert (np.diff(spread[blind], axis=0) > 0.0).all()
    assert len(set(parameter[blind])) == 1
    assert parameter[31] > 0.0
    np.testing.assert_allclose(np.diff(variance[blind]), 0.01 + 0.002, rtol=1e-6)


def test_without_a_gyro_reading_it_is_filterpys():
    settings = {"inertia": "static", "scenario": BLIND, "max_episode_steps": 300}
    compiled = SatInertiaIDEnv(estimator={"name": "adaptive", "log_q_drift": 0.5}, **settings)
    plugged = SatInertiaIDEnv(estimator=FilterpyAdaptiveEKF(log_q_drift=0.5), **settings)
    for env in (compiled, plugged):
        env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (75, 3)).astype(np.float32)
    for action in actions:
        (a, ra, *_), (b, rb, *_) = compiled.step(action), plugged.step(action)
        np.testing.assert_allclose(a, b, rtol=2.0**-20, atol=1e-7)
        assert ra == pytest.approx(rb, rel=1e-7, abs=1e-7)


def test_planners_are_told_of_the_filter_that_is_flown():
    for estimator in ("adaptive", {"name": "momentum", "inertia_walk": 0.001}):
        (mission,) = missions(SatInertiaIDEnv(estimator=estimator).problem)
        assert mission.estimator == estimator_settings(estimator).replace(parameters="principal")


@cases("own", [FilterpyAdaptiveEKF(log_q_drift=0.1), MomentumEKF(inertia_walk=0.001), RateEKF()])
def test_planners_are_told_of_a_plugged_in_filter_of_the_library(own):
    (mission,) = missions(SatInertiaIDEnv(estimator=own).problem)
    assert mission.estimator == own.settings.replace(parameters="principal")


def test_an_inertia_that_walks_faster_than_most_walk_is_followed_once_that_is_raised(microsat):
    """Periodic, 30 % at 0.2 Hz: the cap of 0.02 per sqrt(s) leaves the filter too sure of itself, 0.2 does not."""
    law = InertiaLaw("periodic", size=0.3, frequency=0.2)
    nees = {}
    for most in (0.02, 0.2):
        policy, estimator = RateSquarePolicy(24.0, 2.75), {"name": "adaptive", "inertia_walk_max": most}
        flight = fly_policy(policy, satellite=microsat, inertia=law, seeds=seeds("validation", 4), estimator=estimator)
        nees[most] = float(flight.scores()["nees"].mean())
    assert nees[0.02] > 2.0 * nees[0.2]


@cases(
    ("settings", "message"),
    [
        ({"inertia_walk": -0.001}, "inertia_walk must be"),
        ({"inertia_walk_min": 0.0}, "inertia_walk_min must be"),
        ({"log_q_drift": -1.0}, "log_q_drift must be"),
        ({"inertia_walks": (0.0, 0.001)}, "unknown setting"),
        ({"substeps": 0}, "substeps must be"),
        ({"parameters": "ful"}, "unknown parameters"),
        ({"gate": 0.2}, "gate must be"),
        (
            {"inertia_walk": 0.021},
            "inertia_walk of an adaptive MomentumEKF must be at most .*, 0.02, got 0.021",
        ),
        ({"inertia_walk_min": 0.03}, "raise inertia_walk_max as well"),
        ({"inertia_walk_max": 0.0}, "inertia_walk_max must be"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        MomentumEKFSettings.from_dict({"adaptive": True, **settings})


def test_settings_are_plain_values():
    settings = MomentumEKFSettings(adaptive=True, inertia_walk=0.01, log_q_drift=1)
    assert MomentumEKFSettings.from_dict(settings.to_dict()) == settings
    assert SatInertiaIDEnv(estimator=settings.to_dict()).problem.estimator == settings.replace(parameters="principal")
    default = MomentumEKFSettings(adaptive=True, parameters="principal")
    assert SatInertiaIDEnv(scenario={"estimator": "adaptive"}).problem.estimator == default
