"""Swings and stops for a star tracker: what the law does with what it observes, and what scenario calibration asks."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.scenarios.flights import Cell
from baselines.scenarios.flights import flown as flown_by
from satid_gym import SCENARIOS, Scenario
from satid_gym.evaluation import seeds
from satid_gym.policies import make_baseline
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.swing_and_stop import SIDES, SwingAndStopPolicy
from satid_gym.policy import Mission, missions
from satid_gym.problem import problem
from satid_gym.star_tracker import earth_angle
from tests.cases import cases

TRACKER = SCENARIOS["calibration"].sensors.star_tracker
SETTINGS = {"control": "rate", "observation": "body"}
LIMIT = earth_angle(SCENARIOS["calibration"].orbit_rate) + TRACKER.earth_exclusion  # rad, from the Earth's centre


def mission(scenario="calibration", **settings) -> Mission:
    return missions(problem("microsat", "static", scenario, **{**SETTINGS, **settings}))[0]


def policy(own: Mission, count: int = 1, **settings) -> SwingAndStopPolicy:
    found = SwingAndStopPolicy(**{"margin": 0.0, **settings})
    found.reset(own, list(range(count)))
    return found


def seen(own: Mission, age: float, sun=(0.0, 0.0, 0.0), earth=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Observation (1, size) of a time since the last reading, in decisions, and of the sky."""
    observation = np.zeros((1, max(place.stop for place in own.layout.values())), np.float32)
    observation[0, own.layout["attitude_age"]] = age
    observation[0, own.layout["sun"]], observation[0, own.layout["earth"]] = sun, earth
    return observation


AWAY = {"sun": -TRACKER.boresight, "earth": -TRACKER.boresight}


def flown(found: SwingAndStopPolicy, observations: list[np.ndarray]) -> np.ndarray:
    return np.array([found(observation)[0] for observation in observations])


# the law


def test_it_swings_stops_until_it_has_looked_and_swings_again():
    own = mission()
    found = policy(own, swing=5.0, look=2.0)
    blind, read = seen(own, 9.0, **AWAY), seen(own, 0.0, **AWAY)
    actions = flown(found, [read] + [blind] * 5 + [blind] * 3 + [read] * 2)
    np.testing.assert_allclose(np.abs(actions[:5]), 1.0)
    np.testing.assert_array_equal(actions[5:10], 0.0)
    assert np.abs(actions[10]).min() == 1.0, "two readings are what it stopped for"


def test_without_readings_it_waits_as_long_as_the_tracker_takes_to_find_stars():
    own = mission()
    found = policy(own, swing=3.0, look=2.0)
    actions = flown(found, [seen(own, 9.0, **AWAY)] * 40)
    still = (actions == 0.0).all(axis=1)
    first = np.flatnonzero(still)[0]
    assert first == 3
    settled = 4.0 / own.scenario.tracking_bandwidth  # the rate is then 2 % of what it was
    assert np.flatnonzero(~still[first:])[0] == settled + TRACKER.reacquire + 2.0


@pytest.mark.parametrize("seed", range(6))
def test_a_stop_is_where_neither_sun_nor_earth_is_in_the_way(seed):
    """By the sky's place in the body after the commanded turn, wherever a swing can lead out of the exclusions."""
    own, rng = mission(), np.random.default_rng(seed)
    rate = own.satellite.rate_limit * own.scenario.decision_period
    led = 0
    for _ in range(30):
        found = policy(own, swing=8.0, clearance=0.05)
        sky = rng.standard_normal((2, 3))
        sun, earth = sky / np.linalg.norm(sky, axis=1, keepdims=True)
        actions = flown(found, [seen(own, 0.0, sun, earth)] + [seen(own, 9.0, sun, earth)] * 16)
        turns = [length * rate * side for length in (8, 12, 16) for side in SIDES]
        turn = rate * actions[: np.flatnonzero((actions == 0.0).all(axis=1))[0]].sum(axis=0)

        def clear(turn, sun=sun, earth=earth):
            there = Rotation.from_rotvec(turn).inv().apply([sun, earth]) @ TRACKER.boresight
            return (np.arccos(there) - [TRACKER.sun_exclusion, LIMIT]).min()

        best = max(clear(one) for one in turns)
        assert clear(turn) > min(best, 0.05) - 1e-6
        led += best > 0.05
    assert led > 10


def test_it_turns_about_what_it_has_turned_least():
    """Four swings with the sky out of the way are about the four diagonals of the body."""
    own = mission(SCENARIOS["calibration"].replace(sensors={"star_tracker": TRACKER.replace(
        sun_exclusion=None, earth_exclusion=None)}))  # fmt: skip
    found = policy(own, swing=2.0, look=2.0)
    observation = np.zeros((1, max(place.stop for place in own.layout.values())), np.float32)
    actions = flown(found, [observation] * 40)
    begins = np.flatnonzero(actions.any(axis=1) & ~np.vstack([np.zeros(3), actions[:-1]]).any(axis=1))
    sides = actions[begins[:4]]
    assert np.linalg.matrix_rank(sides.T @ sides) == 3
    assert len({tuple(side * side[0]) for side in sides}) == 4


def test_before_the_attitude_is_known_it_goes_on_the_same_way():
    """For the tracker may be blind for a long arc: the boresight moves as far as a swing takes it."""
    own = mission()
    found = policy(own, swing=4.0)
    actions = flown(found, [seen(own, 10.0)] * 80)
    (side,) = {tuple(action) for action in actions if action.any()}
    along = np.abs(SIDES @ TRACKER.boresight)
    assert abs(np.array(side) @ TRACKER.boresight) == pytest.approx(along.min())


# what it refuses


@cases(
    ("settings", "message"),
    [
        ({"swing": 0.0}, "swing must be"),
        ({"look": -1.0}, "look must be"),
        ({"clearance": -0.1}, "clearance must be"),
        ({"amplitude": 1.5}, "amplitude must be"),
        ({"margin": -1.0}, "margin must be"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        SwingAndStopPolicy(**settings)


def test_it_needs_rates_and_a_star_tracker():
    with pytest.raises(ValueError, match='control="rate"'):
        SwingAndStopPolicy().reset(mission(control="torque"), [0])
    with pytest.raises(ValueError, match=r"a star tracker.*'microsat'"):
        SwingAndStopPolicy().reset(mission("default"), [0])


# the scenario


def test_the_scenario_goes_through_json():
    own = SCENARIOS["calibration"]
    assert Scenario.from_dict(json.loads(json.dumps(own.to_dict()))) == own


@pytest.mark.compiled
def test_stops_are_worth_their_time_there():
    """Against square waves of full rate, which the tracker cannot follow; and the filter stays consistent."""
    cell, those = Cell(scenario="calibration", satellite="microsat", inertia="static"), seeds("validation", 12)
    stops = flown_by(cell, make_baseline("swing_and_stop", "microsat", "calibration"), those)
    square = flown_by(cell, RateSquarePolicy(96.0, 3.5), those)
    assert stops.inside(0.01)
    for flight in (stops, square):
        assert 0.3 < flight.nees.mean() < 2.0
    assert 2.5 * stops.expected_at_end.mean() < square.expected_at_end.mean()
    assert 2.0 * stops.expected.mean() < square.expected.mean()


@pytest.mark.compiled
def test_momentum_that_the_wheels_hold_tells_the_gyros_scale_too():
    """Its direction in the inertial frame stays, so that it turns in the body as the body turns: why wheels begin at
    rest there, for with half of their momentum a square wave needs no stars."""
    full = SCENARIOS["calibration"].replace(wheel_speed_range=0.5)
    found = {}
    for name, scenario in (("little", "calibration"), ("much", full)):
        cell = Cell(scenario=scenario, satellite="microsat", inertia="static")
        found[name] = flown_by(cell, RateSquarePolicy(96.0, 3.5), seeds("validation", 6)).expected_at_end.mean()
    assert 4.0 * found["much"] < found["little"]
