"""Whiteness of the innovations: the statistic, its false alarms, and what comes of what the filter is not told."""

from __future__ import annotations

import dataclasses

import numba
import numpy as np
import pytest
import scipy.signal

from agents.docs.consistency_table import consistency_table
from baselines.scenarios.unmodelled import UnmodelledStudy, cell, mean_nees, show
from baselines.tuning.whiteness_limits import largest, limits
from satid_gym import SatInertiaIDEnv
from satid_gym.core.belief import whiteness
from satid_gym.core.belief.whiteness import FALSE_ALARM_RATE, LIMITS, MEMORY, PRIOR, TIME_CONSTANTS
from satid_gym.estimators import AdaptiveEKF, FilterpyAdaptiveEKF, MomentumEKF, MomentumSmoother
from satid_gym.evaluation import seeds
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import prior_of
from satid_gym.scenario_catalogue import SCENARIOS
from tests.flexible import PANELS
from tests.test_filters import DT, fly
from tests.tolerances import ALL

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


@numba.njit
def _note(beliefs, works, e):
    """(L,) mean R of the filter's watch over innovations e (N, 3), over axes and over the readings after MEMORY."""
    belief, work = beliefs[0], works[0]
    R = np.zeros(len(TIME_CONSTANTS))
    for t in range(len(e)):
        for i in range(3):
            work.normalised[i], work.innovation_variance[i] = e[t, i], 1.0
        whiteness.note(belief, work)
        for k in range(len(R) if t >= MEMORY else 0):
            for i in range(3):
                R[k] += belief.whiteness.variance[k, i] / (3 * (len(e) - MEMORY))
    return R


@numba.njit
def _forget(beliefs, growth):
    whiteness._forget(beliefs[0], growth)


@pytest.mark.compiled
def test_coloured_noise_has_the_variance_that_its_correlations_give(microsat):
    """Of a first-order process of correlation r^k, R is (1 + a r) / (1 - a r)."""
    rng, r = np.random.default_rng(0), 0.8
    e = scipy.signal.lfilter([np.sqrt(1.0 - r * r)], [1.0, -r], rng.standard_normal((200_000, 3)), axis=0)
    readings, ekf = fly(microsat, "static", seconds=1), MomentumEKF()
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    a = np.exp(-1.0 / np.array(TIME_CONSTANTS[1:4]))
    np.testing.assert_allclose(_note(ekf.records, ekf.work, e)[1:4], (1.0 + a * r) / (1.0 - a * r), rtol=0.05)


@pytest.mark.compiled
@pytest.mark.parametrize("growth", [1.001, 4.0, 1e4])
def test_what_readings_told_is_divided_and_the_prior_kept(microsat, growth):
    """(P+)^-1 = P^-1 / g + (1 - 1 / g) S^-1, of six parameters, panels and errors of sensors and wheels."""
    readings = fly(microsat, "static", seconds=10)
    panels = dataclasses.replace(PANELS, frequency_std=0.3, mass_std=0.2, damping_std=0.3)
    satellite = microsat.replace(oscillators=[panels], tolerances=ALL)
    prior = prior_of(satellite, SCENARIOS["default"], "full")
    ekf = MomentumEKF()
    ekf.reset(prior, readings.gyro[0], readings.wheel_speed[0])
    row, size = ekf.record, len(ekf.record["mean"])
    errors, modes, first = row["calibration"], row["modes"], int(row["modes"]["first"])
    S = np.full(size, np.inf)
    S[3:9], S[9:12] = row["prior_theta_std"] ** 2, row["prior_torque_std"] ** 2
    for i, std in enumerate(modes["std"]):
        S[first + 5 * i + 2 : first + 5 * i + 5] = std[2:] ** 2
    S[size - len(errors["prior_covariance"]) :] = np.diag(errors["prior_covariance"])
    known = np.where(np.isfinite(S), S, 1.0)
    assert size > 12 + modes["std"].size > 12
    rng = np.random.default_rng(0)
    root = rng.standard_normal((size, size)) / np.sqrt(size)
    correlation = root @ root.T + 0.1 * np.eye(size)
    scale = 0.3 * np.sqrt(known / np.diag(correlation))  # none beyond its prior
    P = scale[:, None] * correlation * scale
    row["covariance"][:] = P
    _forget(ekf.records, growth)
    unit = np.sqrt(known)
    information = np.linalg.inv(P / np.outer(unit, unit)) / growth + (1.0 - 1.0 / growth) * np.diag(known / S)
    np.testing.assert_allclose(ekf.covariance / np.outer(unit, unit), np.linalg.inv(information), rtol=1e-6, atol=1e-9)
    assert (np.diag(ekf.covariance) <= S * (1.0 + 1e-9)).all()
    assert (np.diag(ekf.covariance) >= np.diag(P)).all()
    np.testing.assert_array_equal(ekf.covariance, ekf.covariance.T)


@pytest.mark.compiled
def test_growth_by_hand(microsat):
    """Of 1/10 of the prior's std and growth 4: 1 / (1 / (4 * 0.01) + 3 / 4) of its variance; at the prior: nothing."""
    readings, ekf = fly(microsat, "static", seconds=1), MomentumEKF()
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    row, prior = ekf.record, ekf.record["prior_theta_std"] ** 2
    row["covariance"][:] = np.diag([1.0, 1.0, 1.0, 0.01 * prior[0], prior[1], 2.0 * prior[2], 1e-12, 1e-12, 1e-12])
    _forget(ekf.records, 4.0)
    found = np.diag(ekf.covariance)[:6] / [1.0, 1.0, 1.0, *prior]
    np.testing.assert_allclose(found, [4.0, 4.0, 4.0, 1.0 / 25.75, 1.0, 2.0], rtol=1e-12)


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
    """To the bit, where no flight of the cell has an alarm."""
    quiet = [row for row in nominal if row["alarmed"] == [0.0, 0.0]]
    assert quiet
    for row in quiet:
        for name in ("final_error", "nees", "nees_settled", "ended"):
            assert row[name][0] == row[name][1], name


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
    for key in ("nis_mean", "colour", "unmodelled", "inflation", "restarts", "inertia_walk", "steps_found"):
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


def test_six_parameters_are_inflated_each_to_its_prior_at_most(microsat):
    """Products that nothing excites keep no moment from being inflated."""
    readings = fly(microsat, "static", seconds=60)
    rng = np.random.default_rng(0)
    readings.gyro += np.sqrt(8.0) * microsat.gyro_noise_std * rng.standard_normal(readings.gyro.shape)
    prior = dataclasses.replace(readings.prior, parameters="full")
    found = {}
    for inflate in (False, True):
        ekf = MomentumEKF(inertia_walk=0.0, inflate=inflate)
        ekf.run(prior, readings.gyro, readings.wheel_speed, DT)
        found[inflate] = np.sqrt(np.diag(ekf.covariance)[3:9])
    assert (found[True][:3] > 1.5 * found[False][:3]).all()
    assert (found[True] <= ekf.record["prior_theta_std"] * (1.0 + 1e-9)).all()


def _shaken(satellite, seconds: int, first: float, last: float):
    """Readings of a static inertia, with a sine of 0.35 Hz, three times the gyro's noise, from `first` to `last`, s."""
    readings = fly(satellite, "static", seconds=seconds)
    t = DT * np.arange(len(readings.gyro))
    sine = np.where((t > first) & (t < last), np.sin(2.0 * np.pi * 0.35 * t), 0.0)
    readings.gyro += 3.0 * satellite.gyro_noise_std * sine[:, None]
    return readings


@pytest.mark.compiled
def test_inflation_ends_after_its_cause(microsat):
    readings = _shaken(microsat, 400, 100.0, 150.0)
    ekf = AdaptiveEKF(inflate=True)
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    factor = []
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        ekf.predict(speed, DT)
        ekf.update(gyro, speed)
        factor.append(float(ekf.record["whiteness"]["factor"]))
    assert max(factor[: round(100.0 / DT) - 1]) == 1.0
    assert factor[round(150.0 / DT)] > 2.0
    assert factor[-1] == 1.0


@pytest.mark.compiled
@pytest.mark.parametrize("rate_coordinates", [False, True])
def test_inflation_ends_though_little_is_known(microsat, rate_coordinates):
    """At rest no moment becomes known to 5 %; the innovations are watched all the same while F is above 1."""
    rng, n = np.random.default_rng(0), 1000
    readings = fly(microsat, "static", seconds=1)
    gyro = microsat.gyro_noise_std * rng.standard_normal((n, 3))
    speed = microsat.tachometer_noise_std * rng.standard_normal((n, microsat.wheels.count))
    ekf = AdaptiveEKF(inflate=True, rate_coordinates=rate_coordinates)
    ekf.reset(readings.prior, gyro[0], speed[0])
    state = ekf.record["whiteness"]
    state["factor"] = state["factor_max"] = 1e3
    state["variance"][:] *= 2.0
    for t in range(1, n):
        ekf.predict(speed[t], DT)
        ekf.update(gyro[t], speed[t])
    assert np.sqrt(ekf.covariance[3, 3]) > 0.05 * ekf.mean[3]
    assert state["factor"] == 1.0


def test_an_alarm_does_not_outlive_a_reset(microsat):
    readings = _shaken(microsat, 60, 20.0, 60.0)
    ekf = AdaptiveEKF(inflate=True)
    ekf.run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    assert ekf.record["whiteness"]["factor"] > 1.0
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    state = ekf.record["whiteness"]
    assert (state["factor"], state["factor_max"], state["readings"]) == (1.0, 1.0, 0)
    assert (state["variance"] == 1.0).all()
    assert (state["smoothed"] == 0.0).all()


def test_a_nees_that_is_not_finite_is_an_error():
    """Unless the flight had ended before."""
    nees = np.array([[1.0, 2.0], [3.0, np.nan]])
    assert mean_nees(nees, np.array([[True, True], [True, False]])) == 2.0
    with pytest.raises(ValueError, match=r"episodes \[1\]"):
        mean_nees(nees, np.ones((2, 2), bool))
    with pytest.raises(ValueError, match="0 readings"):
        mean_nees(nees, np.zeros((2, 2), bool))


def test_no_world_loses_its_own_satellites():
    with pytest.raises(ValueError, match="add pocketqube"):
        UnmodelledStudy(worlds=("as nominal", "1e-3 kg m^2")).check()
    study = UnmodelledStudy(worlds=("as nominal", "1e-3 kg m^2"), satellites=("cubesat", "pocketqube"))
    study.check()
    assert [s.name for w in study.worlds for s in study.satellites_of(w)] == ["cubesat", "pocketqube"]


def test_the_tables_head_names_what_was_flown():
    def flown(world: str, *policies: str) -> list[dict]:
        return [{"world": world, "policy": p, "inertia": "static", "final_error": 0.1, "nees": 1.0} for p in policies]

    results = {"revision": "0123456789ab", "settings": {"episodes": 2}}
    cells = flown("panels 10 %, 0.35 Hz", "rate_square", "sine", "zero")
    assert "| sine: NEES | zero: NEES |" in consistency_table({**results, "cells": cells}, "flexible")
    cells += flown("slosh 3 %, 0.05 Hz", "rate_square", "multi_step", "sine", "zero")
    table = consistency_table({**results, "cells": cells}, "flexible")
    assert "| multi_step, sine: NEES | zero: NEES |" in table
    assert table.endswith("revision 0123456. panels 10 %, 0.35 Hz: rate_square, sine, zero alone.")


def test_the_study_shows_a_line_for_each_world_and_policy(nominal, capsys):
    show(nominal)
    assert capsys.readouterr().out.count("as nominal") == 1
    with pytest.raises(ValueError, match="world"):
        UnmodelledStudy(worlds=("as nominl",)).check()
