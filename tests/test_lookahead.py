"""A learned policy that looks ahead: what it foresees comes true, what it remembers, and what it gains."""

from __future__ import annotations

import copy

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
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.lookahead import LookaheadPolicy
from satid_gym.policy import missions, observation_settings
from satid_gym.problem import problem
from tests.cases import cases
from tests.rehearse import rehearse

COUNT = 4


def begun(scenario, policy, estimator="adaptive", inertia="static", satellite="microsat", span=6):
    """Environment after some decisions at corners, and its last observation."""
    settings = {"control": "rate", **observation_settings(policy)}
    env = SatInertiaIDVectorEnv(COUNT, satellite, inertia, scenario, estimator, **settings)
    policy.reset(missions(env.problem)[0], range(COUNT))
    env.reset(seed=5)
    for corner in CORNERS[[0, 6, 3, 5]]:
        for _ in range(span):
            observation = env.step(np.tile(0.4 * corner, (COUNT, 1)))[0]
    return env, observation


def rolled(env, observation, plan, miss=10.0):
    """Trail after a plan (H, 3) from where each environment is, and what is foreseen to be observed."""
    seer = FilterMPCPolicy(step=1e-9)  # which takes all readings
    seer.reset(missions(env.problem)[0], range(COUNT))
    seer.see(env.fleet.rows.beliefs, env.fleet.rows.tasks)
    flights, seen = seer._flown(), observation.copy()
    trail, scratch = Trail.of(flights, COUNT), scratch_of(flights)
    begin_rollouts(trail, flights, 1, 0.0)
    for action in plan:
        roll_out(trail, np.array(np.broadcast_to(action, (COUNT, 3))), miss, scratch, seen)
    return trail, seen, seer


@pytest.mark.compiled
def test_what_it_would_observe_is_what_is_observed():
    """Windows, targets, rates and wheels after nine decisions, and how uncertain the filter is then."""
    env, observation = begun("operations", LookaheadPolicy("window_tour"), {"name": "momentum", "adaptive": False})
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
def test_windows_that_it_would_miss_are_missed():
    """At rest off the target: as much of each decision as the environment says, within a sample of ten."""
    env, observation = begun("operations", LookaheadPolicy("window_tour"))
    task = env.fleet.rows.tasks
    opens = (task["opens"] - task["decision"] * task["samples"] * task["sample_period"]).max()
    plan = np.zeros((int(opens) + 12, 3))
    loss, plain = (
        np.array([rolled(env, observation, plan[:ahead], miss)[0].losses for ahead in range(len(plan) + 1)])
        for miss in (10.0, 0.0)
    )
    missed = (np.diff(loss, axis=0) / np.diff(plain, axis=0) - 1.0) / 10.0
    costs = np.array([env.step(np.zeros((COUNT, 3)))[4]["costs"]["window"] for _ in plan])
    assert (costs.max(axis=0) == 1.0).all()
    np.testing.assert_allclose(missed, costs, atol=0.1 + 1e-6)


@pytest.mark.interpreted
def test_a_rollout_is_the_rehearsal_of_its_plan():
    """Decision by decision, and all at once."""
    env, observation = begun("slosh", find("rigid_tour"))
    plan = np.repeat(0.5 * CORNERS[[1, 6]], 4, axis=0)
    plan[-2:] = 0.0
    trail, _, seer = rolled(env, observation, plan)
    seer.caution = 0.0
    whole = rehearse(seer, np.broadcast_to(plan, (COUNT, *plan.shape)))
    np.testing.assert_array_equal(trail.losses, [one.losses[-1] for one in whole])
    np.testing.assert_array_equal(trail.beliefs["covariance"], [one.beliefs["covariance"][-1] for one in whole])


@cases(("name", "scenario"), [("window_tour", "operations"), ("tank_tour", "slosh"), ("panel_tour", "flex")])
@pytest.mark.compiled
def test_a_tour_goes_on_from_its_memory_in_any_row(name, scenario):
    """Side and waits, modes on the data sheet, star fixes, and the side on which it turns about the boresight."""
    policy = find(name)
    env, observation = begun(scenario, policy, inertia="periodic")
    mission, own = missions(env.problem)[0], {"features": policy.corner_features, "settle": policy.settle}
    own["is_shaped"] = policy.is_shaped
    tour, other = (CornerTour([mission], policy.margin, **own) for _ in range(2))
    tour.begin(COUNT)
    other.begin(1)
    rows = np.array([2, 0, 0, 3, 1, 2])
    for t in range(65):
        if t == 30:
            other.memory = tour.memory.take(rows)
        action = tour(observation, policy.score)
        if t >= 30:
            np.testing.assert_array_equal(other(observation[rows], policy.score), action[rows])
        observation = env.step(action)[0]
    side, waited, modes, fixes, gaps = tour.memory
    assert all((part[0] != part[1:]).any() for part in (side, waited, modes, *fixes[1:], *gaps) if part.size)


def spares(_):
    """A network of random weights in whose flight tanks are spared."""
    layout = missions(problem("microsat", "static", "slosh", control="rate", observation="body"))[0].layout
    weights = np.random.default_rng(0).normal(size=(3, max(place.stop for place in layout.values())))
    network = Network((weights.astype(np.float32),), (np.zeros(3, np.float32),))
    return LearnedPolicy("spares", network, "rate", 3.5, observation="body", repeat=4, spares_modes=True)


@cases(("make", "scenario"), [(find, "calibration"), (spares, "slosh")])
@pytest.mark.compiled
def test_a_network_goes_on_from_its_memory_in_any_row(make, scenario):
    """In the middle of a command that it repeats."""
    policy, other = make("stargazer"), make("stargazer")
    env, observation = begun(scenario, policy)
    mission, rows = missions(env.problem)[0], np.array([2, 0, 0, 3, 1, 2])
    policy.reset(mission, range(COUNT))
    other.reset(mission, range(1))
    for t in range(40):
        if t == 15:
            other.memory = policy.memory.take(rows)
        action = policy(observation)
        if t >= 15:
            np.testing.assert_allclose(other(observation[rows]), action[rows], rtol=1e-12)  # BLAS sums in another order
        observation = env.step(action)[0]
    assert len(np.unique(policy.memory.command, axis=0)) > 1


def test_a_tour_remembers_what_was_flown_in_place_of_its_choice():
    tour = CornerTour(missions(problem("microsat", "static", control="rate", observation="body")), 3.5, hold=6.0)
    tour.begin(1)
    before = tour.memory
    np.testing.assert_allclose(before.waited, [[6.0, 4.0, 2.0]])
    tour.note(before, np.array([[-0.9, 0.8, -0.2]]))
    np.testing.assert_allclose(tour.memory.side, [[-1.0, 1.0, 1.0]])
    np.testing.assert_allclose(tour.memory.waited, [[1.0, 5.0, 3.0]])


@cases(
    ("name", "scenario", "choices"),
    [("tank_tour", "slosh", 8), ("window_tour", "operations", 9), ("panel_tour", "operations", 9)],
)
@pytest.mark.compiled
def test_it_flies_the_choice_that_loses_least(name, scenario, choices):
    """By rollouts of two decisions, worked out choice by choice; and the same again after a reset."""
    policy, tour = LookaheadPolicy(name, horizon=2, tail=0.0, caution=0.0, step=1e-9), find(name)
    env, observation = begun(scenario, policy, span=2)
    mission, actions = missions(env.problem)[0], []
    for _ in range(2):
        policy.reset(mission, range(COUNT))
        policy.see(env.fleet.rows.beliefs, env.fleet.rows.tasks)
        actions.append(policy(observation))
    np.testing.assert_array_equal(*actions)
    firsts, losses = [], []
    for choice in np.eye(choices)[:, : len(CORNERS)]:
        leaves = not choice.any()
        own = {"features": tour.corner_features, "settle": tour.settle, "is_shaped": tour.is_shaped}
        law = CornerTour([mission], tour.margin, **own)
        law.begin(COUNT)
        firsts.append(law(observation, lambda _, own=choice: np.tile(own, (COUNT, 1)), leaves))
        second = law(rolled(env, observation, firsts[-1:])[1], tour.score, leaves)
        losses.append(rolled(env, observation, [firsts[-1], second])[0].losses)
    best = np.argmin(losses, axis=0)
    assert len(set(best)) > 1
    np.testing.assert_array_equal(actions[0], np.array(firsts)[best, np.arange(COUNT)])
    turns = np.abs(actions[0]) > 0.5
    assert (np.sign(actions[0]) == policy.policy.memory.side)[turns].all()


@pytest.mark.compiled
def test_it_leaves_before_it_is_late():
    """Where the tour alone would still swing, and miss the window by its own settings."""
    tour = find("window_tour")
    tour.settle = 0.0
    late = LookaheadPolicy(tour, horizon=28)
    env, observation = begun("operations", late, satellite="cubesat")
    mission = missions(env.problem)[0]
    late.reset(mission, range(COUNT))
    tour.reset(mission, range(COUNT))
    earlier = np.zeros(COUNT, bool)
    for _ in range(40):
        late.see(env.fleet.rows.beliefs, env.fleet.rows.tasks)
        memory = late.policy.memory
        action = late(observation)
        free = CornerTour([mission], tour.margin, features=tour.corner_features, settle=tour.settle)
        free.begin(COUNT)
        free.memory = memory
        slew = free(observation, tour.score, True)
        free.memory = memory
        earlier |= (action == slew).all(axis=1) & (free(observation, tour.score) != slew).any(axis=1)
        observation = env.step(action)[0]
    assert earlier.any()


@pytest.mark.compiled
def test_a_network_remembers_what_it_commands_though_edits_are_flown():
    policy, alone = LookaheadPolicy("stargazer", horizon=12, edits=8, step=1.0), find("stargazer")
    env, observation = begun("calibration", policy)
    mission = missions(env.problem)[0]
    policy.reset(mission, range(COUNT))
    alone.reset(mission, range(COUNT))
    edited = 0
    for t in range(alone.repeat + 2):
        policy.see(env.fleet.rows.beliefs, env.fleet.rows.tasks)
        action, own = policy(observation), alone(observation)
        decisions, command, _ = policy.policy.memory
        assert decisions == t + 1
        np.testing.assert_array_equal(command, alone.memory.command)
        edited += (action != own).any()
        observation = env.step(action)[0]
    assert edited > 0


@pytest.mark.compiled
def test_copies_that_fly_side_by_side_do_not_disturb_each_other():
    one = LookaheadPolicy("tank_tour", horizon=3)
    env, observation = begun("slosh", one)
    mission, flights = missions(env.problem)[0], (env.fleet.rows.beliefs, env.fleet.rows.tasks)
    pair = copy.copy(one), copy.copy(one)
    for policy in pair:
        policy.reset(mission, range(COUNT))
    sides = []
    for policy in (pair[0], pair[1], pair[0]):
        policy.see(*flights)
        policy(observation)
        sides.append(policy.policy.memory.waited.copy())
    np.testing.assert_array_equal(sides[0], sides[1])
    assert (sides[2] != sides[1]).any()


@cases("name", ["rigid_tour", "tank_tour", "window_tour", "stargazer"])
def test_it_observes_what_its_policy_does(name):
    assert observation_settings(LookaheadPolicy(name, edits=8)) == observation_settings(find(name))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "satellite", "settings"),
    [
        ("operations", "microsat", {"policy": "window_tour", "horizon": 10}),
        ("slosh", "microsat", {"policy": "tank_tour", "horizon": 16, "tail": 5.0, "edits": 24, "caution": 0.0}),
        ("calibration", "cubesat", {"policy": "stargazer", "horizon": 60, "edits": 24, "step": 0.5}),
    ],
)
def test_it_expects_less_than_its_policy(scenario, satellite, settings):
    cell, those = Cell(scenario=scenario, satellite=satellite, inertia="static"), seeds("validation", 4)
    ahead, alone = (flown(cell, policy, those) for policy in (LookaheadPolicy(**settings), find(settings["policy"])))
    assert ahead.inside(0.01)
    assert ahead.expected.mean() < 0.95 * alone.expected.mean()
    assert 0.3 < ahead.nees.mean() < 2.0


@pytest.mark.slow
def test_a_pilot_flies_it_by_its_name():
    policy = make_baseline("lookahead", "microsat")
    satellite = problem("microsat", "static", "tight").satellites[0]
    pilot = Pilot(satellite, policy, scenario="tight", control="rate")
    assert np.abs(pilot.start(0.0, np.zeros(3), np.zeros(3))).max() > 0.0


@cases(
    ("settings", "message"),
    [
        ({"policy": "stargazer"}, "stargazer scores no corners: .* its own flight; give edits, such as 16"),
        ({"policy": "generalist"}, "generalist commands torque or observes wheel by wheel: give a policy for control"),
        ({"policy": "grand_tour"}, "unknown policy .*'grand_tour'"),
        ({"edits": -1}, "edits must be an integer of at least 0"),
        ({"horizon": 1}, "horizon must be an integer of at least 2"),
    ],
)
def test_settings_that_cannot_be(settings, message):
    with pytest.raises(ValueError, match=message):
        LookaheadPolicy(**settings)


@cases(
    ("policy", "settings", "message"),
    [
        ({}, {"control": "torque"}, 'lookahead commands body rates: make the environment with control="rate"'),
        ({"policy": "window_tour", "edits": 8}, {"scenario": "operations"}, "imaging windows.*: give edits=0 and"),
        ({"policy": "window_tour"}, {}, "no star tracker is observed"),
        ({"policy": "stargazer", "edits": 8}, {}, "stargazer takes observations of"),
    ],
)
def test_where_it_cannot_fly(policy, settings, message):
    own = LookaheadPolicy(**policy)
    posed = problem("microsat", "static", **{"control": "rate", **observation_settings(own), **settings})
    with pytest.raises(ValueError, match=message):
        own.reset(missions(posed)[0], [0])


def test_it_is_shown_the_filter_before_each_decision():
    policy = LookaheadPolicy()
    posed = problem("microsat", "static", control="rate", **observation_settings(policy))
    policy.reset(missions(posed)[0], [0])
    with pytest.raises(RuntimeError, match=r"lookahead plans with the filter's records: call .*show_filter"):
        policy(np.zeros((1, max(place.stop for place in missions(posed)[0].layout.values())), np.float32))
