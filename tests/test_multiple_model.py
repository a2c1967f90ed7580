"""The AdaptiveEKF: which model it believes, what that is worth, and that it is one filter in every shell.

Its algebra is held against filterpy's in test_filters and test_env.
"""

from __future__ import annotations

import numpy as np
import pytest
from test_consistency import fly as fly_cell
from test_consistency import square_wave
from test_filters import DT, assert_equal_filters, fly, run_slowly

from satid_gym import SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.core import kernels
from satid_gym.estimators import (
    AdaptiveEKF,
    AdaptiveEKFSettings,
    FilterpyAdaptiveEKF,
    FilterpyMomentumEKF,
    MomentumEKF,
    brief,
    estimator_settings,
)
from satid_gym.interface import INFO_KEYS
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import final_error
from satid_gym.policy import missions
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import SCENARIOS


def weights(ekf: AdaptiveEKF, readings) -> np.ndarray:
    """(N, K) after each reading."""
    ekf.reset(readings.briefing, readings.gyro[0], readings.wheel_speed[0])
    series = [ekf.weights]
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        ekf.predict(speed, DT)
        ekf.update(gyro, speed)
        series.append(ekf.weights)
    return np.array(series)


@pytest.mark.parametrize("settings", [{"dwell": 2.0}, {"inertia_walks": (0.0, 0.1), "parameters": "full"}])
def test_a_short_flight_is_filterpys(settings, microsat):
    """With models that change often and are far apart, so that every term of the mixture counts."""
    readings = fly(microsat, "static", seconds=12)
    run = AdaptiveEKF(**settings).run(readings.briefing, readings.gyro, readings.wheel_speed, DT)
    assert_equal_filters(run, run_slowly(FilterpyAdaptiveEKF(**settings), readings), 1e-8)


def test_a_filter_without_models_is_left_alone(microsat):
    readings = fly(microsat, "static", seconds=12)
    run = MomentumEKF().run(readings.briefing, readings.gyro, readings.wheel_speed, DT)
    assert_equal_filters(run, run_slowly(FilterpyMomentumEKF(), readings))


def test_a_wild_reading_is_guarded_and_counted(microsat):
    ekf = AdaptiveEKF()
    ekf.reset(brief(microsat, SCENARIOS["default"]), (0.02, 0.02, 0.02), (50.0, -50.0, 50.0))
    ekf.predict((-150.0, -250.0, -150.0), DT)
    assert ekf.guarded == 0
    ekf.update((30.0, -30.0, 30.0), (-150.0, -250.0, -150.0))
    ekf._models["guarded"][0, 0] += 2
    ekf.predict((-150.0, -250.0, -150.0), DT)
    assert ekf.guarded == 3


def test_models_that_are_alike_are_one_filter(microsat):
    readings = fly(microsat, "periodic", seconds=60)
    run = MomentumEKF(inertia_walk=0.003).run(readings.briefing, readings.gyro, readings.wheel_speed, DT)
    walks = 0.003 * (1.0 + 1e-9 * np.arange(4))
    same = AdaptiveEKF(inertia_walks=walks).run(readings.briefing, readings.gyro, readings.wheel_speed, DT)
    np.testing.assert_allclose(same.mean, run.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(same.nis, run.nis, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(same.covariance, run.covariance, rtol=1e-6, atol=1e-12)


def test_weights_are_probabilities_that_start_alike(microsat):
    series = weights(AdaptiveEKF(), fly(microsat, "step", seconds=200))
    np.testing.assert_array_equal(series[0], 0.25)
    np.testing.assert_allclose(series.sum(axis=1), 1.0, rtol=1e-12)
    assert (series > 0.0).all()


def test_started_again_it_is_not_broken(microsat):
    readings = fly(microsat, "static", seconds=1)
    ekf = AdaptiveEKF()
    ekf.reset(readings.briefing, readings.gyro[0], readings.wheel_speed[0])
    ekf._rows["broken"] = 1
    kernels.start_filter(ekf._rows, ekf._models, ekf._work, readings.gyro[0], readings.wheel_speed[0])
    assert ekf._rows["broken"][0] == 0


@pytest.mark.compiled
def test_it_believes_the_model_that_holds(microsat):
    """Static: the slowest; periodic: a fast one; a step: the fastest for a moment, and the slowest again."""
    static, periodic, step = (weights(AdaptiveEKF(), fly(microsat, mode)) for mode in ("static", "periodic", "step"))
    assert static[-600:, 0].mean() > 0.9
    assert periodic[-600:, 2].mean() > 0.5
    at = round(150.0 / DT)
    assert step[at - 300 : at, 3].max() < 0.1
    assert step[at : at + 30, 3].max() > 0.9
    assert step[-600:, 0].mean() > 0.9


@pytest.fixture(scope="module")
def cells() -> dict:
    """Default scenario, 50 episodes a cell: (default filter, adaptive)."""
    return {
        (s, mode): tuple(
            fly_cell(square_wave, s, mode, estimator=name, episodes=50) for name in ("momentum", "adaptive")
        )
        for s in SATELLITES
        for mode in INERTIA_MODES
    }


@pytest.mark.parametrize("mode", INERTIA_MODES)
@pytest.mark.parametrize("satellite", SATELLITES)
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
            for key in INFO_KEYS:
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
    """Its uncertainty grows, and its weights tend to their prior as fast as models are drawn anew."""
    dwell = 30.0
    env = SatInertiaIDEnv(inertia="static", scenario=BLIND, estimator={"name": "adaptive", "dwell": dwell})
    env.reset(seed=0)
    part = env.layout["uncertainty"]
    rng = np.random.default_rng(0)
    spread, weights = [], []
    for _ in range(75):
        observation, *_ = env.step(rng.uniform(-0.2, 0.2, 3).astype(np.float32))
        spread.append(observation[part])
        weights.append(env._models["weight"][0].copy())
    blind = slice(31, 69)
    assert (np.diff(spread[blind], axis=0) > 0.0).all()
    apart = np.array(weights[blind]) - 0.25
    np.testing.assert_allclose(apart[1:], np.exp(-1.0 / dwell) * apart[:-1], rtol=1e-9)
    assert np.abs(apart).max() > 0.1


def test_without_a_gyro_reading_it_is_filterpys():
    settings = {"inertia": "static", "scenario": BLIND, "max_episode_steps": 300}
    compiled = SatInertiaIDEnv(estimator={"name": "adaptive", "dwell": 30.0}, **settings)
    plugged = SatInertiaIDEnv(estimator=FilterpyAdaptiveEKF(dwell=30.0), **settings)
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
        told = estimator_settings(mission.scenario.estimator)
        assert told == estimator_settings(estimator)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"inertia_walks": (0.001,)}, 'two or more numbers.*that increase.*"momentum"'),
        ({"inertia_walks": (0.001, 0.001)}, "that increase"),
        ({"inertia_walks": (-0.001, 0.001)}, "at least 0"),
        ({"inertia_walks": 0.001}, "two or more"),
        ({"inertia_walks": ("fast", "slow")}, "inertia_walks must be numeric"),
        ({"dwell": 0.0}, "dwell must be"),
        ({"substeps": 0}, "substeps must be"),
        ({"parameters": "ful"}, "unknown parameters"),
        ({"gate": 1e-6}, "unknown setting"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        AdaptiveEKFSettings.from_dict(settings)


def test_settings_are_plain_values():
    settings = AdaptiveEKFSettings(inertia_walks=[0.0, 0.01], dwell=10)
    assert AdaptiveEKFSettings.from_dict(settings.to_dict()) == settings
    assert SatInertiaIDEnv(estimator=settings.to_dict()).problem.estimator == settings
    assert SatInertiaIDEnv(scenario={"estimator": "adaptive"}).problem.estimator == AdaptiveEKFSettings()
