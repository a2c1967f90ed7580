"""Tours of corners where there is more than a body: gaps between imaging windows, and stars that a rest lets be seen."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.scenarios.flights import Cell, flown
from satid_gym import SCENARIOS, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.control.corner_features import FEATURES, RIGID, features_of, takes_rest
from satid_gym.control.corners import CORNERS, CornerTour
from satid_gym.control.gaps import Gaps
from satid_gym.control.stars_seen import StarLog
from satid_gym.evaluation import seeds
from satid_gym.policies import find
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.network import Network
from satid_gym.policy import Mission, missions
from satid_gym.problem import problem
from satid_gym.star_tracker import earth_angle
from tests.cases import cases

SETTINGS = {"control": "rate", "observation": "body"}
TRACKER = SCENARIOS["calibration"].sensors.star_tracker


def mission(scenario="operations", satellite="microsat") -> Mission:
    return missions(problem(satellite, "static", scenario, **SETTINGS))[0]


def observed(own: Mission, **parts) -> np.ndarray:
    """Observation (1, size) of some parts, zero else, with half of the flight left."""
    observation = np.zeros((1, max(place.stop for place in own.layout.values())))
    for name, value in {"time_left": 0.5, "control_authority": 0.2, **parts}.items():
        observation[0, own.layout[name]] = value
    return observation


def toured(**weights: float) -> LearnedPolicy:
    """A tour whose score has these weights."""
    network = Network((np.array([[*weights.values()]], np.float32),), (np.zeros(1, np.float32),))
    return LearnedPolicy("toured", network, "rate", 3.5, observation="body", corner_features=tuple(weights))


# gaps


def test_on_the_way_to_the_target_it_turns_about_the_boresight_as_it_last_did():
    own = mission()
    gaps = Gaps([own], 3.5, 3.0, "test")
    gaps.begin(1)
    (away,) = (-SCENARIOS["operations"].operations.boresight,)
    free = observed(own, window=[0.9, 1.4], target=[0.5, 0.0, 0.0], sun=away)
    late = observed(own, window=[0.3, 0.8], target=[0.5, 0.0, 0.0], sun=away)
    for side in (1.0, -1.0):
        excitation = side * np.array([[0.2, -0.4, 0.6]])
        np.testing.assert_array_equal(gaps(free, excitation), excitation)
        slew = gaps(late, -excitation)[0]
        assert slew[0] > 0.5
        assert slew[1] == 0.0
        assert np.sign(slew[2]) == side
        assert abs(slew[2]) > 0.8
    soon = observed(own, window=[0.15, 0.65], target=[0.5, 0.0, 0.0], sun=away)
    assert gaps(soon, excitation)[0, 2] == 0.0  # it has to come to rest


def test_a_batch_of_satellites_flies_each_as_it_would_alone():
    names = ["cubesat", "microsat", "smallsat"]
    env = SatInertiaIDVectorEnv(6, names, "static", "operations", num_threads=1, **SETTINGS)
    crew, rows = missions(env.problem), env.satellite_index
    together = CornerTour(crew, 3.5)
    together.assign(rows)
    together.begin(6)
    alone = [CornerTour([crew[row]], 3.5) for row in rows]
    for tour in alone:
        tour.begin(1)
    observation, _ = env.reset(seed=list(range(6)))
    turned = 0
    for _ in range(70):
        action = together(observation)
        for i, tour in enumerate(alone):
            np.testing.assert_array_equal(tour(observation[[i]])[0], action[i])
        turned += (np.abs(action).max(axis=1) < 0.9).any()
        observation, *_ = env.step(action)
    assert turned > 10  # slews and holds were among them
    env.close()


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
@pytest.mark.parametrize("name", ["rigid_tour", "tank_tour"])
def test_tours_that_know_of_no_windows_are_on_the_target_in_time(name, satellite):
    cell = Cell(scenario="operations", satellite=satellite, inertia="static")
    flight = flown(cell, find(name), seeds("validation", 8))
    assert flight.inside(0.012)
    assert 0.3 < flight.nees.mean() < 2.0


# what a tour knows of windows


def test_the_nearer_the_slew_the_more_is_closing_and_a_corner_is_towards_the_target():
    own = mission()
    far = observed(own, window=[0.9, 1.4], target=[0.3, 0.0, 0.0])
    near = observed(own, window=[0.4, 0.9], target=[0.3, 0.0, 0.0])  # 24 s, and 10 s of way at 0.03 rad/s
    tour = CornerTour([own], 0.0, features=("any_closing", "towards"))
    tour.begin(1)
    seen = []
    for observation in (far, near):
        tour(observation, lambda features: seen.append(features) or features[:, :, 0])
        tour.side = CORNERS[[7]]
    (a, b), stays = seen, 7
    assert a[0, stays, 0] == b[0, stays, 0] == 0.0
    np.testing.assert_allclose(b[0, 0, 0], np.exp(-1.4), rtol=1e-9)
    assert a[0, 0, 0] < 0.02
    np.testing.assert_allclose(a[0, :, 1], 0.3 * CORNERS[:, 0], rtol=1e-9)


def test_a_scenario_has_the_features_that_it_has_something_for():
    assert features_of(SCENARIOS["default"]) == RIGID
    slosh, calibration, operations = (set(features_of(SCENARIOS[n])) for n in ("slosh", "calibration", "operations"))
    assert slosh - set(RIGID) == {name for name in FEATURES if "mode" in name or name in slosh} - set(RIGID)
    assert takes_rest(sorted(calibration))
    assert not takes_rest(sorted(slosh))
    assert {"towards", "any_closing", "stars_closing"} == {
        name for name in operations - calibration if "closing" not in name or ("rev" not in name and "gain" not in name)
    } - {"towards_closing"}
    assert slosh | operations == set(FEATURES)


# stars


def test_turns_are_summed_between_readings_and_told_by_the_next():
    own = mission("calibration")
    log = StarLog([own])
    log.begin(1)
    decisions, still = own.scenario.decisions, np.zeros(1, bool)

    def after(decision, age, rate=(0.0, 0.0, 0.0), rests=still):
        left = 1.0 - decision / decisions
        return log(observed(own, time_left=left, attitude_age=age, rate=rate), rests)

    never = after(3, 3.0, rate=(1.0, 0.0, 0.0))  # as old as the flight: no reading yet
    assert not never.known.any()
    assert not never.turned.any()
    first = after(4, 0.4)
    assert first.known.all()
    assert not first.squares.any()
    for decision in (5, 6):
        swung = after(decision, decision - 4.0 + 0.4, rate=(0.5, -1.0, 0.0))
    np.testing.assert_allclose(swung.turned, [[1.0, -2.0, 0.0]])
    assert not swung.squares.any()
    told = after(7, 0.4, rests=~still)
    np.testing.assert_allclose(told.squares, [[1.0, 4.0, 0.0]])
    assert not told.turned.any()
    assert told.rested == told.looked == 1.0
    waits = after(8, 1.4, rests=~still)
    assert (waits.rested, waits.looked) == (2.0, 1.0)
    moves = after(9, 2.4)
    assert moves.rested == moves.looked == 0.0


@cases(("name", "angle"), [("sun", TRACKER.sun_exclusion), ("earth", None)])
def test_clear_is_the_angle_to_what_blinds_the_tracker(name, angle):
    own = mission("calibration")
    angle = angle or earth_angle(own.scenario.orbit_rate) + TRACKER.earth_exclusion
    log, across = StarLog([own]), np.cross(TRACKER.boresight, [0.0, 1.0, 0.0])
    for away in (angle - 0.2, angle + 0.3, angle + 1.5):
        towards = np.cos(away) * TRACKER.boresight + np.sin(away) * across
        log.begin(1)
        clear = log(observed(own, attitude_age=0.2, **{name: towards}), np.zeros(1, bool)).clear
        np.testing.assert_allclose(clear, min(away - angle, 0.5), atol=1e-12)


def test_a_rest_is_a_choice_where_a_score_asks_for_it():
    """It rests from the first decision with one weight, never with the other, and a rest reverses no axis."""
    for weight, rests in ((50.0, True), (-50.0, False)):
        env = SatInertiaIDEnv("microsat", "static", "calibration", **SETTINGS)
        policy = toured(waited=1.0, rest=weight)
        policy.reset(missions(env.problem)[0], [0])
        observation, _ = env.reset(seed=0)
        for _ in range(30):
            action = policy(observation[None])[0]
            assert (np.abs(action).max() == 0.0) == rests
            observation, *_ = env.step(action.astype(np.float32))
        assert (np.abs(policy._tour.side) == 1.0).all()
        env.close()


@cases(
    ("feature", "scenario", "message"),
    [
        ("rest", "default", "no star tracker is observed"),
        ("towards", "calibration", "scenario 'calibration' has none"),
    ],
)
def test_features_of_what_is_not_there_are_refused(feature, scenario, message):
    own = mission(scenario)
    with pytest.raises(ValueError, match=message):
        toured(**{feature: 1.0}).reset(own, [0])
