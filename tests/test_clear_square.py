"""`clear_square`: square waves of rate that leave the wheels clear of a band of speed."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.rivals import Quieter
from satid_gym import SatInertiaIDVectorEnv
from satid_gym.evaluation import seeds
from satid_gym.gym_api import COSTS
from satid_gym.policies import build
from satid_gym.policies.clear_square import ClearSquarePolicy
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policy import only_mission

CELL = Cell(scenario="wheels4", satellite="microsat", inertia="static")
BAND = COSTS.index("avoided_band")


def _env(count=8, **settings):
    return SatInertiaIDVectorEnv(count, CELL.satellite, CELL.inertia, CELL.scenario, **{"control": "rate", **settings})


@pytest.mark.interpreted
def test_a_part_is_where_no_wheel_comes_near_the_band():
    """By the truth: wheels at both ends of the part that is flown, whichever way the momentum is shared at first."""
    env, policy = _env(), ClearSquarePolicy(room=5.0)
    policy.reset(only_mission(env.problem), range(8))
    observation, _ = env.reset(seed=5)
    for _ in range(30):
        action = policy(observation)
        observation, *_ = env.step(action.astype(np.float32))
    assert np.abs(action).min(axis=1).max() > 0.1
    np.testing.assert_allclose(np.abs(action).min(axis=1), np.abs(action).max(axis=1), rtol=0.05)  # a diagonal
    speeds = np.abs(env.fleet.rows.plants["wheel_speed"])
    assert (speeds.min(axis=1) > env.problem.satellites[0].wheels.avoided_speed[1]).mean() > 0.8
    env.close()


def test_it_excites_more_than_a_square_wave_that_spends_as_little_time_in_the_band():
    flights = seeds("validation", 12)
    clear = flown(CELL, ClearSquarePolicy(), flights)
    square = flown(CELL, Quieter(RateSquarePolicy(12.0, 3.5), 0.2), flights)
    loud = flown(CELL, Quieter(RateSquarePolicy(12.0, 3.5), 0.5), flights)
    assert clear.expected.mean() < 0.8 * square.expected.mean()
    assert clear.costs[:, BAND].mean() < 0.5 * loud.costs[:, BAND].mean()
    assert 0.3 < clear.nees.mean() < 2.0
    assert not clear.terminated.any()


@pytest.mark.parametrize(
    ("settings", "message"), [({"period": 0.0}, "period must be"), ({"room": -1.0}, "room must be")]
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        build("clear_square", settings)


def test_it_needs_rates_and_the_speed_of_each_wheel():
    for settings, message in (({"control": "torque"}, "commands body rates"), ({"observation": "body"}, "each wheel")):
        env = _env(1, **settings)
        with pytest.raises(ValueError, match=message):
            ClearSquarePolicy().reset(only_mission(env.problem), [0])
