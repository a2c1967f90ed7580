"""A learned tour that looks ahead: what it foresees comes true, what it remembers, and what it gains."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.scenarios.flights import Cell, flown
from satid_gym import Pilot, SatInertiaIDVectorEnv
from satid_gym.control.corners.tour import CORNERS, CornerTour
from satid_gym.control.planning.rehearsal import Trail
from satid_gym.control.planning.rollout import begin_rollouts, roll_out
from satid_gym.evaluation import seeds
from satid_gym.policies import find, make_baseline
from satid_gym.policies.filter_mpc import FilterMPCPolicy, scratch_of
from satid_gym.policies.lookahead_tour import LookaheadTourPolicy
from satid_gym.policy import missions, observation_settings
from satid_gym.problem import problem
from tests.cases import cases

COUNT = 4


def begun(scenario, policy, estimator="adaptive", inertia="static"):
    """Environment after some decisions at corners, and its last observation."""
    settings = {"control": "rate", **observation_settings(policy)}
    env = SatInertiaIDVectorEnv(COUNT, "microsat", inertia, scenario, estimator, **settings)
    policy.reset(missions(env.problem)[0], range(COUNT))
    env.reset(seed=5)
    for corner in CORNERS[[0, 6, 3, 5]]:
        for _ in range(6):
            observation = env.step(np.tile(0.4 * corner, (COUNT, 1)))[0]
    return env, observation


def rolled(env, observation, plan):
    """Trail after a plan (H, 3) from where each environment is, and what is foreseen to be observed."""
    seer = FilterMPCPolicy(step=1e-9)  # which takes all readings
    seer.reset(missions(env.problem)[0], range(COUNT))
    seer.see(env.fleet.rows.beliefs, env.fleet.rows.tasks)
    flights, seen = seer._flown(), observation.copy()
    trail, scratch = Trail.of(flights, COUNT), scratch_of(flights)
    begin_rollouts(trail, flights, 1, 0.0)
    for action in plan:
        roll_out(trail, np.array(np.broadcast_to(action, (COUNT, 3))), scratch, seen)
    return trail, seen, seer


@pytest.mark.compiled
def test_what_it_would_observe_is_what_is_observed():
    """Windows, targets, rates and wheels after nine decisions, and how uncertain the filter is then."""
    env, observation = begun("operations", LookaheadTourPolicy("window_tour"), {"name": "momentum", "adaptive": False})
    plan = np.repeat(0.4 * CORNERS[[5, 2, 4]], 3, axis=0)
    _, seen, _ = rolled(env, observation, plan)
    for action in plan:
        flown_to = env.step(np.tile(action, (COUNT, 1)))[0]
    place = missions(env.problem)[0].layout
    assert (flown_to[:, place["window"]] > 0.0).all(), "the first window is still to come"
    for name, tolerance in (
        ("window", 1e-6),
        ("time_left", 1e-6),
        ("command", 1e-6),
        ("target", 0.02),
        ("rate", 0.02),
        ("wheel_momentum", 0.02),
        ("uncertainty", 0.1),
    ):
        assert np.abs(flown_to[:, place[name]] - observation[:, place[name]]).max() > 2.0 * tolerance, name
        np.testing.assert_allclose(seen[:, place[name]], flown_to[:, place[name]], atol=tolerance, err_msg=name)


@pytest.mark.compiled
def test_a_rollout_is_the_rehearsal_of_its_plan():
    """Decision by decision, and all at once."""
    env, observation = begun("slosh", find("rigid_tour"))
    plan = np.repeat(0.5 * CORNERS[[1, 6]], 4, axis=0)
    plan[-2:] = 0.0
    trail, _, seer = rolled(env, observation, plan)
    seer.caution = 0.0
    whole = seer.rehearse(np.broadcast_to(plan, (COUNT, *plan.shape)))
    np.testing.assert_array_equal(trail.losses, [one.losses[-1] for one in whole])
    np.testing.assert_array_equal(trail.beliefs["covariance"], [one.beliefs["covariance"][-1] for one in whole])


@cases(("name", "scenario"), [("window_tour", "operations"), ("tank_tour", "slosh")])
@pytest.mark.compiled
def test_a_tour_goes_on_from_its_memory_in_any_row(name, scenario):
    """Side and waits, modes on the data sheet, star fixes, and the side on which it turns about the boresight."""
    policy = find(name)
    env, observation = begun(scenario, policy, inertia="periodic")
    mission, own = missions(env.problem)[0], {"features": policy.corner_features, "settle": policy.settle}
    tour, other = (CornerTour([mission], policy.margin, **own) for _ in range(2))
    tour.begin(COUNT)
    other.begin(1)
    rows = np.array([2, 0, 0, 3, 1, 2])
    for t in range(60):
        if t == 30:
            other.memory = tour.memory.take(rows)
        action = tour(observation, policy.score)
        if t >= 30:
            np.testing.assert_array_equal(other(observation[rows], policy.score), action[rows])
        observation = env.step(action)[0]
    side, waited, modes, fixes, gaps = tour.memory
    assert all((part[0] != part[1:]).any() for part in (side, waited, modes, *fixes[1:], *gaps) if part.size)


def test_a_tour_remembers_what_was_flown_in_place_of_its_choice():
    tour = CornerTour(missions(problem("microsat", "static", control="rate", observation="body")), 3.5, hold=6.0)
    tour.begin(1)
    before = tour.memory
    np.testing.assert_allclose(before.waited, [[6.0, 4.0, 2.0]])
    tour.note(before, np.array([[-0.9, 0.8, -0.2]]))
    np.testing.assert_allclose(tour.memory.side, [[-1.0, 1.0, 1.0]])
    np.testing.assert_allclose(tour.memory.waited, [[1.0, 5.0, 3.0]])


@pytest.mark.compiled
def test_it_flies_the_corner_that_loses_least():
    """By rollouts of two decisions, worked out corner by corner; and the same again after a reset."""
    policy, tour = LookaheadTourPolicy("tank_tour", horizon=2, tail=0.0, caution=0.0), find("tank_tour")
    env, observation = begun("slosh", policy)
    mission, actions = missions(env.problem)[0], []
    for _ in range(2):
        policy.reset(mission, range(COUNT))
        policy.see(env.fleet.rows.beliefs, env.fleet.rows.tasks)
        actions.append(policy(observation))
    np.testing.assert_array_equal(*actions)
    firsts, losses = [], []
    for choice in np.eye(len(CORNERS)):
        law = CornerTour([mission], tour.margin, features=tour.corner_features)
        law.begin(COUNT)
        firsts.append(law(observation, lambda _, own=choice: np.tile(own, (COUNT, 1))))
        second = law(rolled(env, observation, firsts[-1:])[1], tour.score)
        losses.append(rolled(env, observation, [firsts[-1], second])[0].losses)
    best = np.argmin(losses, axis=0)
    assert len(set(best)) > 1
    np.testing.assert_array_equal(actions[0], np.array(firsts)[best, np.arange(COUNT)])
    np.testing.assert_array_equal(policy.tour_memory.side, np.sign(actions[0]))


@cases("name", ["rigid_tour", "tank_tour", "window_tour"])
def test_it_observes_what_the_tour_does(name):
    assert observation_settings(LookaheadTourPolicy(name)) == observation_settings(find(name))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("operations", {"tour": "window_tour", "horizon": 10}),
        ("slosh", {"tour": "tank_tour", "horizon": 16, "tail": 5.0, "edits": 24, "caution": 0.0}),
    ],
)
def test_it_expects_less_than_the_tour(scenario, settings):
    cell, those = Cell(scenario=scenario, satellite="microsat", inertia="static"), seeds("validation", 4)
    ahead, tour = (flown(cell, policy, those) for policy in (LookaheadTourPolicy(**settings), find(settings["tour"])))
    assert ahead.inside(0.01)
    assert ahead.expected.mean() < 0.95 * tour.expected.mean()
    assert 0.3 < ahead.nees.mean() < 2.0


@pytest.mark.slow
def test_a_pilot_flies_it_by_its_name():
    policy = make_baseline("lookahead_tour", "microsat")
    satellite = problem("microsat", "static", "tight").satellites[0]
    pilot = Pilot(satellite, policy, scenario="tight", control="rate")
    assert np.abs(pilot.start(0.0, np.zeros(3), np.zeros(3))).max() > 0.0


@cases(
    ("settings", "message"),
    [
        ({"tour": "stargazer"}, "stargazer scores no corners: give a tour, such as rigid_tour"),
        ({"tour": "grand_tour"}, "unknown policy .*'grand_tour'"),
        ({"edits": -1}, "edits must be an integer of at least 0"),
        ({"horizon": 1}, "horizon must be an integer of at least 2"),
    ],
)
def test_settings_that_cannot_be(settings, message):
    with pytest.raises(ValueError, match=message):
        LookaheadTourPolicy(**settings)


@cases(
    ("policy", "settings", "message"),
    [
        ({}, {"control": "torque"}, 'lookahead_tour commands body rates: make the environment with control="rate"'),
        ({"tour": "window_tour", "edits": 8}, {"scenario": "operations"}, "imaging windows.*: give edits=0"),
        ({"tour": "window_tour"}, {}, "no star tracker is observed"),
    ],
)
def test_where_it_cannot_fly(policy, settings, message):
    own = LookaheadTourPolicy(**policy)
    posed = problem("microsat", "static", **{"control": "rate", **observation_settings(own), **settings})
    with pytest.raises(ValueError, match=message):
        own.reset(missions(posed)[0], [0])


def test_it_is_shown_the_filter_before_each_decision():
    policy = LookaheadTourPolicy()
    posed = problem("microsat", "static", control="rate", **observation_settings(policy))
    policy.reset(missions(posed)[0], [0])
    with pytest.raises(RuntimeError, match=r"lookahead_tour plans with the filter's records: call .*show_filter"):
        policy(np.zeros((1, max(place.stop for place in missions(posed)[0].layout.values())), np.float32))
