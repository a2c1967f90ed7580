"""Whiteness of the innovations: the statistic, its false alarms, and what comes of what the filter is not told."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal
from test_filters import DT, fly

from baselines.scenarios.unmodelled import UnmodelledStudy, cell, show
from baselines.tuning.whiteness_limits import largest, limits
from satid_gym import SatInertiaIDEnv
from satid_gym.core.belief.whiteness import FALSE_ALARM_RATE, LIMITS, MEMORY, PRIOR, TIME_CONSTANTS
from satid_gym.estimators import AdaptiveEKF, FilterpyAdaptiveEKF, MomentumEKF, MomentumSmoother
from satid_gym.evaluation import seeds
from satid_gym.satellite import SATELLITES

EPISODES = 12
NOMINAL = UnmodelledStudy(episodes=EPISODES)


def innovations(ekf: MomentumEKF, readings) -> np.ndarray:
    """(N, 3) innovations that are watched, each over the Cholesky factor of its covariance H P H^T + R."""
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    found = []
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        ekf.predict(speed, DT)
        P, watched = ekf.covariance[:6, :6], int(ekf.record["whiteness"]["readings"])
        ekf.update(gyro, speed)
        if ekf.record["whiteness"]["readings"] > watched:
            H = ekf.work["rows"][0][:3, :6]
            root = np.linalg.cholesky(np.eye(3) + H @ P @ H.T)
            found.append(np.linalg.solve(root, ekf.work["innovation"][0][:3]))
    return np.array(found)


def long_run(e: np.ndarray, T: float) -> np.ndarray:
    """(3,) R of innovations (N, 3) as it is defined, sum by sum."""
    a = np.exp(-1.0 / T) if T > 0.0 else 0.0
    lag = np.arange(len(e))[:, None] - np.arange(len(e))
    weight = np.where(lag >= 0, (1.0 - a) * a ** np.maximum(lag, 0), 0.0)
    y, expected = weight @ e, (weight**2).sum(axis=1)
    R = np.ones(3)
    for t, ratio in enumerate(y**2 / expected[:, None], 1):
        R += (ratio - R) / min(t + PRIOR, MEMORY)
    return R


def test_the_statistic_is_that_of_the_textbook(microsat):
    """Innovations by their covariance in full, R by its definition."""
    readings = fly(microsat, "static", seconds=40)
    ekf = AdaptiveEKF()
    e = innovations(ekf, readings)
    assert 200 < len(e) < 400  # none while a moment is known to no better than 5 %
    expected = [long_run(e, T) for T in TIME_CONSTANTS]
    np.testing.assert_allclose(ekf.record["whiteness"]["variance"], expected, rtol=1e-6)


def test_coloured_noise_has_the_variance_that_its_correlations_give():
    """Of a first-order process of correlation r^k, R is (1 + a r) / (1 - a r)."""
    rng, r = np.random.default_rng(0), 0.8
    e = scipy.signal.lfilter([np.sqrt(1.0 - r * r)], [1.0, -r], rng.standard_normal((200_000, 3)), axis=0)
    for T in TIME_CONSTANTS[1:4]:
        a = np.exp(-1.0 / T)
        y = scipy.signal.lfilter([1.0 - a], [1.0, -a], e, axis=0)
        R = (y**2).mean() * (1.0 + a) / (1.0 - a)
        assert pytest.approx((1.0 + a * r) / (1.0 - a * r), rel=0.05) == R


def test_limits_are_those_of_white_noise():
    found = largest(1000, 3000, seed=1)
    share = (found > np.array(LIMITS)).any(axis=1).mean()
    assert share < FALSE_ALARM_RATE + 3.0 * np.sqrt(FALSE_ALARM_RATE / len(found))
    white = limits(found, FALSE_ALARM_RATE)
    np.testing.assert_allclose(LIMITS[2:], white[2:], rtol=0.2)
    assert (LIMITS[:2] > white[:2]).all()


@pytest.fixture(scope="module")
def nominal() -> list[dict]:
    return [
        cell(NOMINAL, "as nominal", "rate_square", SATELLITES["microsat"], law) for law in ("static", "step", "drift")
    ]


@pytest.mark.compiled
def test_nominal_flights_raise_no_more_alarms_than_is_said(nominal):
    """Beyond 2 in 36 a rate of 1 % is not to be believed: 0.6 % of such tests."""
    alarms = sum(row["alarmed"][0] for row in nominal) * EPISODES
    assert alarms <= 2


@pytest.mark.compiled
def test_nominal_flights_are_not_changed(nominal):
    for row in nominal:
        assert row["final_error"][1] == pytest.approx(row["final_error"][0], rel=0.02)
        assert row["nees"][1] == pytest.approx(row["nees"][0], rel=0.05)


@pytest.mark.compiled
@pytest.mark.parametrize(("policy", "worse"), [("rate_square", 1.05), ("multi_step", 1.5)])
def test_a_periodic_inertia_is_seldom_taken_for_what_is_not_modelled(policy, worse):
    """Its lag colours the innovations; where that raises an alarm it costs accuracy, not consistency."""
    row = cell(NOMINAL, "as nominal", policy, SATELLITES["microsat"], "periodic")
    assert row["alarmed"][0] < 0.4
    assert row["final_error"][1] < worse * row["final_error"][0]
    assert 0.3 < row["nees"][1] < 2.5


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("world", "policy", "nees"),
    [("panels 10 %, 0.35 Hz", "rate_square", 50.0), ("panels 10 %, 0.35 Hz", "sine", 5.0)],
)
def test_panels_that_it_is_not_told_of_are_noticed(world, policy, nees):
    study = UnmodelledStudy(worlds=(world,), satellites=("microsat",), episodes=6)
    (satellite,) = study.satellites_of(world)
    row = cell(study, world, policy, satellite, "static")
    assert row["nees"][0] > nees
    assert row["nees"][1] < 5.0
    assert row["final_error"][1] < row["final_error"][0]
    assert row["alarmed"] == [1.0, 1.0]


@pytest.mark.compiled
def test_a_large_gyro_bias_is_noticed():
    row = cell(NOMINAL, "gyro bias 1e-3 rad/s", "rate_square", SATELLITES["microsat"], "static")
    assert row["alarmed"][0] > 0.9
    assert row["nees"][1] < 0.5 * row["nees"][0]


def test_info_says_what_the_filter_says(microsat):
    """Of the row's own filter, and of the same one given as an object."""
    infos = []
    for estimator in ("adaptive", AdaptiveEKF()):
        env = SatInertiaIDEnv(microsat, "static", estimator=estimator)
        env.reset(seed=seeds("tuning", 1)[0])
        for t in range(20):
            _, _, _, _, info = env.step(np.full(3, 0.3 if t // 5 % 2 else -0.3, np.float32))
        infos.append(info)
    for key in ("nis_mean", "colour", "unmodelled", "inflation", "inertia_walk", "steps_found"):
        assert infos[0][key] == pytest.approx(infos[1][key], rel=1e-9), key
    assert type(infos[0]["unmodelled"]) is bool
    assert infos[0]["inflation"] == 1.0
    assert 0.8 < infos[0]["nis_mean"] < 1.2
    assert infos[0]["inertia_walk"] < 0.005


def test_a_filter_that_does_not_inflate_says_so(microsat):
    with pytest.raises(ValueError, match="does not inflate"):
        FilterpyAdaptiveEKF(inflate=True)
    readings = fly(microsat, "static", seconds=1)
    with pytest.raises(ValueError, match="inflate=False"):
        MomentumSmoother(inflate=True).run(readings.prior, readings.gyro, readings.wheel_speed, DT)


def test_inflation_multiplies_noise_and_covariance(microsat):
    """Readings with three times the noise they are said to have: F near 9 over its limit, squared."""
    readings = fly(microsat, "static", seconds=60)
    rng = np.random.default_rng(0)
    readings.gyro += np.sqrt(8.0) * microsat.gyro_noise_std * rng.standard_normal(readings.gyro.shape)
    run = (readings.prior, readings.gyro, readings.wheel_speed, DT)
    plain, inflated = MomentumEKF(inertia_walk=0.0), MomentumEKF(inertia_walk=0.0, inflate=True)
    before, after = plain.run(*run).inertia_covariance[-1], inflated.run(*run).inertia_covariance[-1]
    state = inflated.record["whiteness"]
    assert state["factor"] == pytest.approx((state["variance"][0].max() / LIMITS[0]) ** 2, rel=1e-9)
    assert plain.record["whiteness"]["factor"] == 1.0
    assert np.linalg.eigvalsh(after - 2.0 * before).min() > 0.0


def test_the_study_shows_a_line_for_each_world_and_policy(nominal, capsys):
    show(nominal)
    assert capsys.readouterr().out.count("as nominal") == 1
    with pytest.raises(ValueError, match="world"):
        UnmodelledStudy(worlds=("as nominl",)).check()
