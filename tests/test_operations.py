"""Imaging windows: what is drawn, what it costs to miss them, what is observed, and the baselines that keep them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.in_the_gaps import InTheGaps
from baselines.scenarios.plans.window import WindowPlan
from satid_gym import SCENARIOS, SatInertiaIDEnv, SatInertiaIDVectorEnv, Scenario
from satid_gym.control.pointing import Pointing
from satid_gym.core.observation import observed_std
from satid_gym.core.observed_sky import WINDOW_UNIT
from satid_gym.evaluation import seeds
from satid_gym.fleet import Fleet
from satid_gym.gym_api import COSTS
from satid_gym.onboard.pilot import Pilot
from satid_gym.operations import Operations
from satid_gym.policies.operator import OperatorPolicy
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.swing_between import SwingBetweenPolicy
from satid_gym.policy import missions
from satid_gym.problem import problem
from tests.cases import cases

OWN = SCENARIOS["operations"].operations
BORESIGHT = OWN.boresight.copy()
SETTINGS = {"control": "rate", "observation": "body"}
CELL = Cell(scenario="operations", satellite="microsat", inertia="static")


def mission(scenario="operations", **settings):
    return missions(problem("microsat", "static", scenario, **{**SETTINGS, **settings}))[0]


def angle(one, other) -> np.ndarray:
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=-1), np.sum(np.multiply(one, other), axis=-1))


# what is drawn


def windows(seed: int, side: float, decisions: int = 600, **settings) -> np.ndarray:
    """(K, 5) opening, closing and target of each window of an episode, and the first boresight and the Sun."""
    env = SatInertiaIDEnv("microsat", "static", "operations", **SETTINGS, **settings)
    env.reset(seed=seed)
    plant = env.fleet.rows.plants[0]
    first = Rotation.from_quat(plant["attitude"]).apply(BORESIGHT)
    found = []
    for t in range(decisions):
        own = plant["operations"]
        found.append([own["opens"], own["closes"], *own["target"]])
        env.step(np.full(3, side if t % 20 < 10 else -side, np.float32))
    kept = [row for row, before in zip(found, [None, *found], strict=False) if row != before]
    return np.array(kept), first, plant["tracker"]["sun"].copy()


@pytest.mark.parametrize("seed", range(4))
def test_windows_come_as_the_scenario_has_them(seed):
    kept, first, sun = windows(seed, 0.0)
    gaps, lengths = kept[:, 0] - np.array([0.0, *kept[:-1, 1]]), kept[:, 1] - kept[:, 0]
    assert len(kept) >= 600 / (OWN.gap[1] + OWN.window[1])
    for found, (low, high) in ((gaps, OWN.gap), (lengths, OWN.window)):
        assert (found >= low).all()
        assert (found <= high).all()
    targets = np.array([first, *kept[:, 2:]])
    np.testing.assert_allclose(np.linalg.norm(targets, axis=1), 1.0)
    share = angle(targets[1:], targets[:-1]) / (0.03 * gaps)
    assert (share >= OWN.slew[0] - 1e-9).all()
    assert (share <= OWN.slew[1] + 1e-9).all()
    clear = OWN.keep_out + OWN.clearance
    assert (angle(targets, sun) > clear - 1e-9).all()
    assert (angle(targets[1:] + targets[:-1], sun) > clear - 1e-9).all()


def test_windows_are_the_same_whatever_is_flown_and_others_in_another_episode():
    calm, *_ = windows(7, 0.0, 200)
    wild, *_ = windows(7, 0.8, 200)
    np.testing.assert_array_equal(calm, wild)
    other, *_ = windows(8, 0.0, 200)
    assert abs(other[0, 0] - calm[0, 0]) > 1e-3


def test_without_operations_nothing_is_drawn_asked_or_observed():
    """The same world but for the windows: equal readings until they are drawn, last of all, from the stream."""
    bare = SCENARIOS["operations"].replace(operations=None)
    env = SatInertiaIDEnv("microsat", "static", bare, **SETTINGS)
    env.reset(seed=3)
    own = env.fleet.rows.plants[0]["operations"]
    assert not own["on"]
    assert not own["stream"].any()
    assert not env.fleet.rows.plants[0]["tracker"]["sun"].any()
    *_, info = env.step(np.full(3, 0.3, np.float32))
    assert info["costs"]["window"] == info["costs"]["keep_out"] == 0.0
    assert not {"window", "target", "sun"} & set(env.layout)
    with_windows = SatInertiaIDEnv("microsat", "static", "operations", **SETTINGS)
    with_windows.reset(seed=3)
    for name in ("inertia", "attitude", "wheel_speed", "gyro_gain"):
        here, there = (e.fleet.rows.plants[0][name] for e in (env, with_windows))
        if name in ("inertia", "gyro_gain"):
            np.testing.assert_array_equal(here, there)


# what it costs


def test_costs_are_the_shares_of_the_samples_that_miss_what_is_asked():
    """Against the log of every sample's true attitude and rate, under an operator that comes a little late."""
    made = problem("microsat", "static", "operations", **SETTINGS)
    fleet = Fleet(made, 1, log=True)
    fleet.rows.plants["stream"][0] = np.random.default_rng(5).integers(1, 2**64, 4, dtype=np.uint64)
    fleet.begin()
    rows = fleet.rows
    late = OperatorPolicy(settle=0.0)
    late.reset(missions(made)[0], [0])
    seen = {"window": set(), "keep_out": set()}
    for t in range(250):
        own = rows.plants["operations"][0].copy()
        action = late(rows.observations.copy()) if t % 100 < 70 else np.array([[0.9, -0.9, 0.9]])
        fleet.step(action.astype(np.float32))
        log, sun = rows.logs[0], rows.plants["tracker"]["sun"][0]
        boresight = Rotation.from_quat(log["attitude"]).apply(BORESIGHT)
        is_open = (log["time"] >= own["opens"]) & (log["time"] <= own["closes"] + 0.1)
        missed = (angle(boresight, own["target"]) > OWN.pointing) | (
            np.linalg.norm(log["rate"], axis=1) > OWN.steadiness
        )
        costs = dict(zip(("window", "keep_out"), rows.reports["costs"][0][-2:], strict=True))
        if own["closes"] > log["time"][-1]:  # the next window begins with another target
            assert costs["window"] == pytest.approx((is_open & missed).mean(), abs=1e-12)
        assert costs["keep_out"] == pytest.approx((angle(boresight, sun) < OWN.keep_out).mean(), abs=1e-12)
        for name, cost in costs.items():
            seen[name].add(float(np.sign(cost)))
    assert seen["window"] == {0.0, 1.0}


def test_looking_at_the_sun_costs():
    env = SatInertiaIDEnv("microsat", "static", "operations", **SETTINGS)
    env.reset(seed=1)
    plant = env.fleet.rows.plants[0]
    for off, cost in ((0.9 * OWN.keep_out, 1.0), (1.1 * OWN.keep_out, 0.0)):
        turned = Rotation.from_rotvec([off, 0.0, 0.0]).apply(BORESIGHT)
        plant["tracker"]["sun"] = Rotation.from_quat(plant["attitude"]).apply(turned)
        *_, info = env.step(np.zeros(3, np.float32))
        assert info["costs"]["keep_out"] == cost
        assert info["cost"] == max(info["costs"].values())


# what is observed


def test_windows_and_targets_are_observed_by_the_estimated_attitude():
    env = SatInertiaIDEnv("microsat", "static", "operations", **SETTINGS)
    observation, info = env.reset(seed=4)
    for t in range(150):
        plant = env.fleet.rows.plants[0]
        own, to_body = plant["operations"], Rotation.from_quat(plant["attitude"]).inv()
        at = [(own[name] - info["time"]) / WINDOW_UNIT for name in ("opens", "closes")]
        np.testing.assert_allclose(observation[env.layout["window"]], at, rtol=1e-6, atol=1e-6)
        turn = observation[env.layout["target"]].astype(float)
        std = np.linalg.norm(observed_std(observation[env.layout["attitude_uncertainty"]].astype(float)))
        there = Rotation.from_rotvec(turn).apply(BORESIGHT)
        assert angle(there, to_body.apply(own["target"])) < 6.0 * std + 1e-5
        assert abs(turn @ BORESIGHT) < 1e-6, "the least turn has no part about the boresight"
        assert angle(observation[env.layout["sun"]], to_body.apply(plant["tracker"]["sun"])) < 6.0 * std + 1e-5
        observation, *_, info = env.step(np.full(3, 0.3 if t % 40 < 20 else -0.3, np.float32))


def test_one_flies_as_many_do():
    env = SatInertiaIDEnv("microsat", "random", "operations", **SETTINGS)
    envs = SatInertiaIDVectorEnv(3, "microsat", "random", "operations", **SETTINGS)
    single, _ = env.reset(seed=12)
    many, _ = envs.reset(seed=[11, 12, 13])
    policies = OperatorPolicy(), OperatorPolicy()
    for found, own, count in ((policies[0], env, 1), (policies[1], envs, 3)):
        found.reset(missions(own.problem)[0], [0] * count)
    for _ in range(120):
        np.testing.assert_array_equal(single, many[1])
        action = policies[0](single[None])
        single, reward, *_, info = env.step(action[0].astype(np.float32))
        many, rewards, *_, infos = envs.step(policies[1](many).astype(np.float32))
        assert reward == rewards[1]
        assert info["costs"] == {name: infos["costs"][name][1] for name in info["costs"]}


# what is refused


@cases(
    ("settings", "message"),
    [
        ({"boresight": [0.0, 0.0, 0.0]}, "boresight of the payload"),
        ({"gap": (60.0, 35.0)}, r"gap of the operations must be \(low, high\)"),
        ({"window": (0.0, 35.0)}, "window of the operations must be"),
        ({"slew": (0.2, 1.2)}, "slew of the operations must be"),
        ({"slew": (0.2, 0.3, 0.4)}, "slew"),
        ({"pointing": 0.0}, "pointing of the operations"),
        ({"steadiness": -1.0}, "steadiness of the operations"),
        ({"keep_out": 1.0}, "keep_out of the operations"),
        ({"keep_out": 0.5, "clearance": 0.5}, "so that targets are left"),
        ({"windows": 3}, "windows"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        SCENARIOS["operations"].replace(operations=settings)


def test_operations_need_an_attitude():
    for given in ({"sensors": None}, {"estimator": "rate"}):
        with pytest.raises(ValueError, match="star_tracker, and a filter that takes its readings"):
            problem("microsat", scenario=SCENARIOS["operations"].replace(**given))
    with pytest.raises(ValueError, match="operations must be Operations or a mapping"):
        Scenario(operations=3)


@pytest.mark.parametrize("policy", [OperatorPolicy(), SwingBetweenPolicy(), InTheGaps(RateSquarePolicy(12.0, 3.5))])
def test_baselines_need_rates_and_windows(policy):
    with pytest.raises(ValueError, match='control="rate"'):
        policy.reset(mission(control="torque"), [0])
    with pytest.raises(ValueError, match="no imaging windows"):
        policy.reset(mission("calibration"), [0])


@cases(
    ("make", "message"),
    [
        (lambda: OperatorPolicy(settle=-1.0), "settle must be"),
        (lambda: SwingBetweenPolicy(swing=0.0), "swing must be"),
        (lambda: SwingBetweenPolicy(roll=1.5), "roll must be"),
        (lambda: SwingBetweenPolicy(amplitude=0.0), "amplitude must be"),
        (lambda: SwingBetweenPolicy(margin=-1.0), "margin must be"),
        (lambda: Pilot("microsat", scenario="operations", control="rate"), "a pilot is not told of imaging windows"),
    ],
)
def test_bad_baselines_and_pilots_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_the_scenario_goes_through_json():
    own = SCENARIOS["operations"]
    assert Scenario.from_dict(json.loads(json.dumps(own.to_dict()))) == own


# the baselines


def test_a_way_past_the_sun_goes_round_it():
    """Kinematics alone: the boresight follows the commanded rates from one side of the keep-out to the other."""
    own = mission()
    guide, rng = Pointing([own], 0.0, "test"), np.random.default_rng(0)
    size = max(place.stop for place in own.layout.values())
    for _ in range(20):
        body = Rotation.random(random_state=rng.integers(2**31))
        start, across = body.apply(BORESIGHT), body.apply([1.0, 0.0, 0.0])
        half = OWN.keep_out + 0.1
        turn = np.cross(start, across) / np.linalg.norm(np.cross(start, across))
        off = rng.uniform(-0.3, 0.3)
        sun = Rotation.from_rotvec(half * turn).apply(start)
        sun = Rotation.from_rotvec(off * np.cross(turn, sun)).apply(sun)
        target = Rotation.from_rotvec(2.0 * half * turn).apply(start)
        nearest, taken, expected = np.inf, None, np.inf
        for t in range(120):
            here = body.inv()
            axis = np.cross(BORESIGHT, here.apply(target))
            observation = np.zeros((1, size))
            observation[0, own.layout["window"]] = [1.0, 2.0]
            observation[0, own.layout["sun"]] = here.apply(sun)
            observation[0, own.layout["target"]] = axis / np.linalg.norm(axis) * angle(BORESIGHT, here.apply(target))
            view = guide.view(observation)
            if t == 0:
                expected = float(guide.duration(view)[0])
            action = guide.clear_of_sun(view, guide.slew(view, guide.fastest(view)))[0]
            assert np.abs(action).max() <= 1.0 + 1e-9
            body = body * Rotation.from_rotvec(0.03 * action)
            nearest = min(nearest, float(angle(body.apply(BORESIGHT), sun)))
            if taken is None and angle(body.apply(BORESIGHT), target) < 0.01:
                taken = t + 1
        assert nearest > OWN.keep_out
        assert taken is not None
        assert taken < expected


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_a_step_of_the_inertia_costs_no_window(satellite):
    """After a step the attitude was not known until the body turned again: 2 to 5 % of the time was lost."""
    cell, those = Cell(scenario="operations", satellite=satellite, inertia="step"), seeds("validation", 12)
    for policy in (OperatorPolicy(settle=6.0), SwingBetweenPolicy(settle=6.0)):
        flight = flown(cell, policy, those)
        print(f"{policy.name}: {flight.costs.mean(axis=0).max():.2%}")
        assert flight.inside(0.006)


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_baselines_keep_every_limit_and_swings_teach_more(satellite):
    cell, those = Cell(scenario="operations", satellite=satellite, inertia="static"), seeds("validation", 6)
    operator, swings = (
        flown(cell, policy, those) for policy in (OperatorPolicy(settle=6.0), SwingBetweenPolicy(settle=6.0))
    )
    for flight in (operator, swings):
        assert flight.inside(0.01)
        assert 0.3 < flight.nees.mean() < 2.0
    assert 2.0 * swings.expected.mean() < operator.expected.mean()


def test_a_plan_has_sides_of_its_own_in_each_gap():
    """What it prefers is flown in that gap and in no other."""
    points = np.zeros((2, WindowPlan.size))
    preferred = points[1, 2:].reshape(-1, 8)
    preferred[0, 5], preferred[1, 2] = 50.0, 50.0
    envs = SatInertiaIDVectorEnv(2, "microsat", "static", "operations", **SETTINGS)
    plan = WindowPlan(points)
    plan.reset(missions(envs.problem)[0], [3, 3])
    observation, _ = envs.reset(seed=[3, 3])
    sides = []
    for _ in range(160):
        observation, *_ = envs.step(plan(plan.told(envs, observation)).astype(np.float32))
        sides.append((int(plan._gap[1]), tuple(plan._side[1]), plan._left[1] > 0.0))
    flown_sides = {gap: {side for own, side, swings in sides if own == gap and swings} for gap in (0, 1)}
    assert flown_sides[0] == {(-1.0, 1.0, -1.0)}
    assert flown_sides[1] == {(1.0, -1.0, 1.0)}
    envs.close()


def test_a_policy_in_the_gaps_flies_as_it_would_alone():
    """Until it is time to go: the same actions as the square wave by itself, the Sun being far."""
    own = mission()
    gaps, alone = InTheGaps(RateSquarePolicy(12.0, 3.5)), RateSquarePolicy(12.0, 3.5)
    for found in (gaps, alone):
        found.reset(own, [0])
    observation = np.zeros((1, max(place.stop for place in own.layout.values())))
    observation[0, own.layout["window"]], observation[0, own.layout["target"]] = [0.9, 1.4], [0.3, 0.0, 0.0]
    observation[0, own.layout["sun"]] = -BORESIGHT
    for _ in range(20):
        np.testing.assert_array_equal(gaps(observation), alone(observation))
    observation[0, own.layout["window"]] = [0.15, 0.65]
    action = gaps(observation)[0]
    assert action[0] > 0.1
    assert not action[1:].any()


def test_operations_are_equal_by_value():
    assert Operations() == OWN
    assert Operations(gap=(30.0, 50.0)) != OWN


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_noise_of_the_tachometers_is_no_excitation_where_the_body_is_at_rest(satellite):
    """With tachometers as on the data sheet too: the operator never turns about the boresight."""
    coarse = SCENARIOS["operations"].replace(tachometer_noise_std=None)
    cell = Cell(scenario=coarse, satellite=satellite, inertia="static")
    assert 0.3 < flown(cell, OperatorPolicy(), seeds("validation", 24)).nees.mean() < 2.0


@pytest.mark.compiled
@pytest.mark.parametrize("policy", [OperatorPolicy(), SwingBetweenPolicy()], ids=lambda policy: policy.name)
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_a_step_of_the_inertia_at_rest_is_found_once_the_body_turns(satellite, policy):
    """No reading depends on the inertia of a body at rest: what is believed until it turns is of the time before."""
    chosen = seeds("validation", 24)
    env = SatInertiaIDVectorEnv(24, satellite, "step", "operations", **SETTINGS)
    policy.reset(missions(env.problem)[0], chosen)
    observation, _ = env.reset(seed=chosen)
    plants, turned = env.fleet.rows.plants, np.zeros(24)
    nees, stepped, turns = [], [], []
    for _ in range(env.problem.scenario.decisions):
        observation, _, _, _, info = env.step(policy(observation))
        after = plants["stepped"] == 1
        rate = np.abs(plants["rate"]).max(axis=1) / env.problem.satellites[0].rate_limit
        turned += after & (rate > 0.1)
        nees.append(info["nees"].copy())
        stepped.append(after.copy())
        turns.append(turned.copy())
    env.close()
    nees, stepped, turns = np.array(nees), np.array(stepped), np.array(turns)
    assert 0.3 < nees[~stepped].mean() < 2.0
    assert 0.3 < nees[stepped & (turns > 5)].mean() < 2.0  # s, at one decision a second
    assert nees[stepped & (turns == 0)].mean() > 100.0


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_filter_is_consistent_from_the_first_second(satellite):
    """One reading at full torque takes the moments from 30 % to 3, and one linearisation is far off then.

    What that left was later taken for a step of the inertia.
    """
    chosen, policy = seeds("validation", 256), SwingBetweenPolicy()
    env = SatInertiaIDVectorEnv(256, satellite, "static", "operations", **SETTINGS)
    policy.reset(missions(env.problem)[0], chosen)
    observation, _ = env.reset(seed=chosen)
    observation, *_, info = env.step(policy(observation))
    assert 0.3 < info["nees"].mean() < 1.5
    assert np.quantile(info["nees"], 0.99) < 7.0
    for _ in range(120):
        observation, *_ = env.step(policy(observation))
    assert not env.fleet.rows.beliefs["adaptation"]["steps"].any()
    env.close()


@pytest.mark.compiled
def test_rates_keep_off_their_limit_by_what_the_gyro_may_misread():
    """Motors are so quiet here that the gyro's scale alone keeps rates off their limit."""
    cell = Cell(scenario="operations", satellite="smallsat", inertia="periodic")
    flight = flown(cell, SwingBetweenPolicy(), seeds("validation", 24))
    assert flight.costs.mean(axis=0)[COSTS.index("rate")] < 0.002
