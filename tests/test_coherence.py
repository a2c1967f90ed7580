"""Coherence: an inertia that moves while no reading tells of it is as far off as the filter says."""

from __future__ import annotations

import numpy as np
import pytest
from test_filters import DT, assert_equal_filters, fly, run_slowly

from baselines.scenarios.flights import Cell, flown
from satid_gym import InertiaLaw, SatInertiaIDVectorEnv
from satid_gym.estimators import AdaptiveEKF, FilterpyAdaptiveEKF
from satid_gym.evaluation import seeds
from satid_gym.policies.learned.shipped import find
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.swing_between import SwingBetweenPolicy
from satid_gym.policy import missions

EPISODES, REST = 32, 40


def rested(law: InertiaLaw, usual_age: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """NEES (N,) after a minute of excitation and a rest of 40 s, and growth of theta's std in that rest (N,).

    `usual_age`, s, takes the place of the filter's own.
    """
    chosen, policy = seeds("validation", EPISODES), RateSquarePolicy(period=12.0, margin=3.5)
    env = SatInertiaIDVectorEnv(EPISODES, "microsat", law, "default", control="rate", observation="body")
    adaptation, covariance = env.fleet.rows.beliefs["adaptation"], env.fleet.rows.beliefs["covariance"]
    policy.reset(missions(env.problem)[0], chosen)
    observation, _ = env.reset(seed=chosen)
    for _ in range(60):
        observation, *_ = env.step(policy(observation))
    for _ in range(4):  # coming to rest excites too
        env.step(np.zeros((EPISODES, 3), np.float32))
    before = np.linalg.det(covariance[:, 3:6, 3:6])
    for _ in range(REST):
        if usual_age is not None:
            adaptation["usual_age"] = usual_age
        *_, info = env.step(np.zeros((EPISODES, 3), np.float32))
    growth = (np.linalg.det(covariance[:, 3:6, 3:6]) / before) ** (1.0 / 6.0)
    nees = info["nees"].copy()
    env.close()
    return nees, growth


def test_the_growth_is_filterpys(microsat):
    """Excitation, a rest in which the variance grows faster than by the walk, and excitation again."""
    readings = fly(microsat, "periodic", seconds=120, rest=(70.0, 110.0))
    ekf, fastest = AdaptiveEKF(), 0.0
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        known, scale = ekf.covariance[3, 3], ekf.record["theta_scale"][0]
        ekf.predict(speed, DT)
        fastest = max(fastest, (ekf.covariance[3, 3] - known) / (ekf.inertia_walk * scale) ** 2 / DT)
        ekf.update(gyro, speed)
    assert fastest > 3.0
    run = AdaptiveEKF().run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    assert_equal_filters(run, run_slowly(FilterpyAdaptiveEKF(), readings), 1e-8)


@pytest.mark.compiled
def test_an_inertia_that_moved_unseen_is_as_far_off_as_the_filter_says():
    """By a random walk alone the filter is certain of what was true before the rest."""
    drift = InertiaLaw("drift", size=0.3, time=300.0)
    assert 0.2 < rested(drift)[0].mean() < 2.0
    assert rested(drift, usual_age=1e9)[0].mean() > 4.0


@pytest.mark.compiled
def test_an_inertia_that_stays_is_not_doubted_for_a_rest():
    nees, growth = rested(InertiaLaw("static"))
    assert 0.2 < nees.mean() < 2.0
    np.testing.assert_allclose(growth, rested(InertiaLaw("static"), usual_age=1e9)[1], rtol=0.1)


@pytest.mark.compiled
@pytest.mark.parametrize("inertia", ["static", "step", "drift", "periodic"])
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_filter_is_consistent_between_and_in_imaging_windows(satellite, inertia):
    for policy in (SwingBetweenPolicy(), find("window_tour")):
        flight = flown(
            Cell(scenario="operations", satellite=satellite, inertia=inertia), policy, seeds("validation", 16)
        )
        assert 0.3 < flight.nees.mean() < 2.0
