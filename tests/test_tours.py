"""Tours of corners between imaging windows, by what a star tracker has seen, and by ways that panels allow."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.scenarios.flights import Cell, flown
from satid_gym import SCENARIOS, SatInertiaIDVectorEnv
from satid_gym.control.corners.choice import Choice
from satid_gym.control.corners.features import FEATURES, features_of
from satid_gym.control.corners.star_fixes import StarFixes
from satid_gym.control.corners.tour import CORNERS, CornerTour
from satid_gym.control.gaps import Gaps
from satid_gym.control.mode_shaping import bearable
from satid_gym.control.observed_modes import ObservedModes
from satid_gym.core.observation import MODE_PARTS
from satid_gym.evaluation import seeds
from satid_gym.policies import find
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policies.swing_between import SwingBetweenPolicy
from satid_gym.policy import Mission, missions
from satid_gym.problem import problem
from tests.cases import cases

SETTINGS = {"control": "rate", "observation": "body"}


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


@cases("boresight", [[0.0, 0.0, 1.0], [6e-17, 0.0, 1.0]])
def test_on_the_way_to_the_target_it_turns_about_the_boresight_as_it_last_did(boresight):
    own = mission(SCENARIOS["operations"].replace(operations={"boresight": boresight}))
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


def test_an_episode_that_leaves_slews_though_there_is_time():
    own = mission(SCENARIOS["operations"])
    gaps = Gaps([own], 3.5, 3.0, "test")
    gaps.begin(2)
    away = -SCENARIOS["operations"].operations.boresight
    free = np.repeat(observed(own, window=[0.9, 1.4], target=[0.5, 0.0, 0.0], sun=away), 2, axis=0)
    excitation = np.tile([0.2, -0.4, 0.6], (2, 1))
    stays, leaves = gaps(free, excitation, np.array([False, True]))
    np.testing.assert_array_equal(stays, excitation[0])
    assert leaves[0] > 0.5
    assert leaves[1] == 0.0


@cases(("scenario", "is_shaped"), [("operations", False), ("flex", True)])
def test_a_batch_of_satellites_flies_each_as_it_would_alone(scenario, is_shaped):
    names = ["cubesat", "microsat", "smallsat"]
    env = SatInertiaIDVectorEnv(6, names, "static", scenario, num_threads=1, **SETTINGS)
    crew, rows = missions(env.problem), env.satellite_index
    together = CornerTour(crew, 3.5, is_shaped=is_shaped)
    together.assign(rows)
    together.begin(6)
    alone = [CornerTour([crew[row]], 3.5, is_shaped=is_shaped) for row in rows]
    for tour in alone:
        tour.begin(1)
    observation, _ = env.reset(seed=list(range(6)))
    turned = 0
    for _ in range(70):
        action = together(observation)
        for i, tour in enumerate(alone):
            np.testing.assert_array_equal(tour(observation[[i]])[0], action[i])
        turned += (np.abs(action) < 0.9).any()
        observation, *_ = env.step(action)
    assert turned > 10  # slews and holds, or steps on the way, were among them
    env.close()


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
@pytest.mark.parametrize("name", ["rigid_tour", "tank_tour"])
def test_tours_that_know_of_no_windows_are_on_the_target_in_time(name, satellite):
    cell = Cell(scenario="operations", satellite=satellite, inertia="static")
    flight = flown(cell, find(name), seeds("validation", 8))
    assert flight.inside(0.012)
    assert 0.3 < flight.nees.mean() < 2.0


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_tour_for_windows_expects_less_than_swings_and_the_tour_it_began_as(satellite):
    cell, those = Cell(scenario="operations", satellite=satellite, inertia="static"), seeds("validation", 16)
    learned, *others = (
        flown(cell, policy, those) for policy in (find("window_tour"), find("rigid_tour"), SwingBetweenPolicy())
    )
    assert learned.inside(0.01)
    assert 0.3 < learned.nees.mean() < 2.0
    for other in others:  # geometric mean: once in a while the filter takes something for a step, and begins again
        assert np.log(learned.expected).mean() < np.log(other.expected).mean()


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
    slosh, calibration, operations, wheels4 = (
        features_of(SCENARIOS[name]) for name in ("slosh", "calibration", "operations", "wheels4")
    )
    rigid = set(features_of(SCENARIOS["default"]))
    assert {"peak", "drive_speed"} <= set(slosh) - rigid
    assert {"stars", "stars_onward"} <= set(calibration) - rigid - set(slosh)
    assert {"towards", "any_closing", "stars_closing"} <= set(operations) - set(calibration)
    assert {"band_crossing", "band_stay"} <= set(wheels4) - rigid - set(slosh) - set(operations)
    assert set(slosh) | set(operations) | set(wheels4) == set(FEATURES)


# stars


def test_rotation_is_summed_between_fixes_and_squared_by_the_next():
    own = mission("calibration")
    fixes = StarFixes([own])
    fixes.begin(1)

    def after(age, rate=(0.0, 0.0, 0.0), left=0.5):
        fixes.update(observed(own, time_left=left, attitude_age=age, rate=rate))
        return fixes.turn, fixes.squares

    for never in (after(0.0, rate=(1.0, 0.0, 0.0), left=1.0), after(1.0, rate=(1.0, 0.0, 0.0))):
        assert not never[0].any()
    assert not after(0.4)[1].any()  # the first fix tells nothing of the rotation before
    for age in (1.4, 2.4):
        turn, squares = after(age, rate=(0.5, -1.0, 0.0))
    np.testing.assert_allclose(turn, [[1.0, -2.0, 0.0]])
    assert not squares.any()
    turn, squares = after(0.4)
    np.testing.assert_allclose(squares, [[1.0, 4.0, 0.0]])
    assert not turn.any()


def test_stars_tell_more_after_a_corner_about_axes_that_were_turned_least():
    """By the log of what they would tell, s and s^2 by hand: 7 s at a corner, and 3 s that tell little."""
    own = mission("calibration")
    tour = CornerTour([own], 0.0, features=("stars", "stars_onward"))
    tour.begin(1)
    tour._fixes._fixed[:] = True
    tour._fixes.turn[:], tour._fixes.squares[:] = [[6.0, 0.0, 0.0]], [[0.0, 100.0, 0.0]]
    seen = []
    tour(observed(own, attitude_age=5.0), lambda features: seen.append(features) or features[:, :, 0])
    (stars, onward), known = seen[0][0].T, np.array([9.0, 109.0, 9.0])
    turned = np.array([6.0, 0.0, 0.0]) + 7.0 * CORNERS
    expected = (np.log1p(turned**2 / known) - np.log1p([4.0, 0.0, 0.0])).mean(axis=1)
    np.testing.assert_allclose(stars, expected, rtol=1e-9)
    np.testing.assert_allclose(onward, 6.0 * CORNERS[:, 0] / 30.0, rtol=1e-9)


@cases(
    ("feature", "scenario", "message"),
    [
        ("stars", "default", "no star tracker is observed"),
        ("towards", "calibration", "scenario 'calibration' has none"),
    ],
)
def test_features_of_what_is_not_there_are_refused(feature, scenario, message):
    own = mission(scenario)
    with pytest.raises(ValueError, match=message):
        toured(**{feature: 1.0}).reset(own, [0])


# ways that panels allow


def bent(pull: float, frequency: float = 0.1) -> np.ndarray:
    """Observation of panels at rest, hinged about z, that full rates about x and y pull to a multiple of the limit."""
    own = mission("flex")
    parts = dict.fromkeys(MODE_PARTS, 0.0) | {"frequency": frequency, "deflection_limit": 1.0}
    parts |= {"frequency_std": -10.0, "coupling": [0.0, 0.0, 0.3], "centrifugal": [0.0, 0.0, 0.0, 0.5 * pull, 0.0, 0.0]}
    modes = np.concatenate([np.zeros(MODE_PARTS[name]) + value for name, value in parts.items()])
    return observed(own, time_left=1.0, modes=modes)


@cases(("pull", "size"), [(0.5, 1.0), (0.9, 1.0), (1.8, np.sqrt(0.5)), (3.6, 0.5), (-3.6, 0.5)])
def test_corners_are_as_small_as_the_pull_of_their_rotation_needs(pull, size):
    modes = ObservedModes([mission("flex")], 1.0, 0.0).read(bent(pull))
    corners = bearable(modes, CORNERS[None], 0.9)
    np.testing.assert_allclose(corners[0], size * CORNERS, rtol=1e-12)
    assert np.abs(modes.pulled(corners)).max() == pytest.approx(min(abs(pull), 0.9))


def test_a_shaped_tour_turns_at_once_about_the_axes_that_bend_nothing():
    own = mission("flex")
    tour = CornerTour([own], 0.0, is_shaped=True)
    tour.begin(1)
    action = tour(bent(0.0))
    np.testing.assert_array_equal(np.abs(action[0, :2]), 1.0)
    assert 0.0 < abs(action[0, 2]) < 0.5


def test_what_a_tour_takes_of_panels_is_of_the_mode_nearest_to_its_limit():
    rates = np.array([[[1.0, -1.0, 0.5], [1.0, 1.0, 0.5]]])
    modes = ObservedModes([mission("flex")], 1.0, 0.0).read(bent(0.8))
    given = dict.fromkeys(("wait_score", "fixes", "foreseen", "peak", "band", "craft", "waited", "reverses"))
    choice = Choice(seen={}, corners=rates, modes=modes, period=1.0, decisions=300, **given)
    np.testing.assert_allclose(choice.pull, [[-0.8, 0.8]])


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_tour_for_panels_keeps_the_limit_and_expects_less_than_square_waves(satellite):
    cell, those = Cell(scenario="flex", satellite=satellite, inertia="static"), seeds("validation", 32)
    learned, square = (flown(cell, policy, those) for policy in (find("panel_tour"), ShapedSquarePolicy()))
    assert learned.inside(0.01)
    assert 0.3 < learned.nees.mean() < 2.0
    assert np.log(learned.expected).mean() < np.log(square.expected).mean()


@pytest.mark.parametrize("name", ["panel_tour", "tank_tour"])
def test_tours_for_panels_and_tanks_fly_where_there_are_none(name):
    flight = flown(Cell(scenario="default", satellite="microsat", inertia="static"), find(name), seeds("validation", 4))
    assert flight.inside(0.01)
    assert flight.expected.mean() < 1e-3
