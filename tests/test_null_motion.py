"""Null motion of the rate loop: four wheels or more stay out of a band of speed, and the body does not notice."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.scenarios.flights import AnyCell, flown
from baselines.studies.worlds.satellites import PYRAMID, on_pyramid
from satid_gym import SATELLITES, ReactionWheels, SatInertiaIDVectorEnv
from satid_gym.evaluation import seeds
from satid_gym.gym_api import COSTS
from satid_gym.policies.rate_square import RateSquarePolicy
from tests.cases import cases
from tests.test_rate_tracking import QUIET

FIVE = np.column_stack([PYRAMID, [0.0, 0.0, 1.0]])
SIX = np.column_stack([np.eye(3), np.eye(3)])
FULL = {"name": "momentum", "parameters": "full"}  # as in other tests with four wheels, so that they share kernels


def _wheels(axes):
    return ReactionWheels(axes=axes, inertia=2e-3, max_torque=0.1, max_speed=900.0)


@cases("axes", [PYRAMID, FIVE, SIX])
def test_the_null_direction_leaves_no_momentum_and_moves_every_wheel(axes):
    direction = _wheels(axes).null_direction
    np.testing.assert_allclose(axes @ direction, 0.0, atol=1e-12)
    assert np.abs(direction).max() == pytest.approx(1.0)
    assert np.abs(direction).min() > 0.3


def test_four_wheels_on_the_diagonals_of_a_cube_turn_alike():
    np.testing.assert_allclose(np.abs(_wheels(PYRAMID).null_direction), 1.0)


def _flown(avoided, decisions=40, scenario=QUIET, range_=0.2):
    """Rates (N, 3) and wheel speeds (N, 4) of each decision, and the last share of time in the band."""
    satellite = on_pyramid(SATELLITES["microsat"], avoided)
    world = {**scenario, "wheel_speed_range": range_}
    env = SatInertiaIDVectorEnv(6, satellite, "static", world, FULL, control="rate")
    env.reset(seed=3)
    rates, speeds, band = [], [], None
    for decision in range(decisions):
        side = 1.0 if decision % 16 < 8 else -1.0
        *_, info = env.step(np.full((6, 3), 0.3 * side, np.float32))
        plants = env.fleet.rows.plants
        rates.append(plants["rate"].copy())
        speeds.append(plants["wheel_speed"].copy())
        band = info["in_avoided_band"]
    return np.array(rates), np.array(speeds), band


def test_wheels_keep_their_distance_and_the_body_follows_all_the_same():
    """A turn at the rate limit changes a wheel by at most 117 rad/s, and this one is at 0.3 of it."""
    rates, speeds, band = _flown((0.0, 10.0))
    plain, even, _ = _flown((0.0, 0.0))
    np.testing.assert_allclose(rates, plain, atol=2e-3 * SATELLITES["microsat"].rate_limit)
    assert np.abs(speeds[20:]).min() > 60.0
    assert np.abs(even[20:]).min() < 10.0
    assert (band == 0.0).all()


def test_a_band_that_does_not_begin_at_rest_is_kept_out_of_from_either_side():
    _, speeds, band = _flown((300.0, 320.0))
    assert (band == 0.0).all()
    assert not ((np.abs(speeds[20:]) >= 300.0) & (np.abs(speeds[20:]) <= 320.0)).any()


def shared_evenly(env, observation):
    """Let wheels share the momentum evenly, as if they had no speed to avoid; what is observed stays."""
    env.fleet.rows.tasks["tracking"]["null"]["on"] = 0
    return observation


def test_full_rates_are_flown_with_hardly_any_time_in_the_band():
    """Sharing the momentum evenly, the wheels spend a fifth of the time there."""
    pyramid = on_pyramid(SATELLITES["microsat"], (0.0, 10.0))
    cell = AnyCell(scenario="default", satellite=pyramid, inertia="static")
    band = COSTS.index("avoided_band")
    kept = flown(cell, RateSquarePolicy(24.0, 3.5), seeds("validation", 6))
    even = flown(cell, RateSquarePolicy(24.0, 3.5), seeds("validation", 6), shared_evenly)
    assert kept.costs[:, band].mean() < 0.015
    assert even.costs[:, band].mean() > 0.1
    assert kept.expected.mean() == pytest.approx(even.expected.mean(), rel=0.1)
    assert 0.3 < kept.nees.mean() < 2.0


def test_where_operators_avoid_nothing_wheels_share_the_momentum_evenly():
    env = SatInertiaIDVectorEnv(1, on_pyramid(SATELLITES["microsat"]), "static", QUIET, control="rate")
    assert env.fleet.rows.tasks["tracking"]["null"]["on"][0] == 0
    three = SATELLITES["microsat"]
    three = three.replace(wheels=three.wheels.replace(avoided_speed=(0.0, 10.0)))
    env = SatInertiaIDVectorEnv(1, three, "static", QUIET, control="rate")
    env.reset(seed=0)
    assert env.fleet.rows.tasks["tracking"]["null"]["on"][0] == 0
