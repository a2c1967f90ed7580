"""The gate of a scenario: what flights score, what the oracle is told, how policies are chosen and compared."""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.scenarios import gate as gates
from baselines.scenarios import rivals
from baselines.scenarios.flights import Cell, Flown, flown, unit_free_error
from baselines.scenarios.gate import Gate, over, row, show
from baselines.scenarios.oracle import search
from baselines.scenarios.plans.corner import CornerPlan
from baselines.scenarios.plans.shaped import ShapedPlan, with_true_modes
from baselines.scenarios.plans.swing import SwingPlan, with_true_sky
from baselines.scenarios.rate_loops import RateLoopStudy
from baselines.scenarios.rivals import Quieter, choose
from satid_gym import SATELLITES
from satid_gym.core.observation import MODE_PLACES as AT
from satid_gym.gym_api import COSTS
from satid_gym.policies.corner_tour import CornerTourPolicy
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import RandomPolicy, ZeroPolicy
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policy import missions, observation_settings
from satid_gym.profiles import PROFILES
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.vector import SatInertiaIDVectorEnv
from tests.cases import cases

CELL = Cell(scenario="flex", satellite="microsat", inertia="static")
SEEDS = [11, 12, 13]
POINTS = 0.3 * np.random.default_rng(4).standard_normal((3, 7))


def world(count: int = 3, scenario="flex", **settings) -> SatInertiaIDVectorEnv:
    return SatInertiaIDVectorEnv(
        count, "microsat", "static", scenario, **{"control": "rate", "observation": "body", **settings}
    )


def scored(*expected: float, cost: float = 0.0, ended: bool = False) -> Flown:
    """Episodes that cost alike, all of which end early or none."""
    n, errors = len(expected), np.array(expected)
    costs = np.full((n, len(COSTS)), cost)
    return Flown(errors, np.zeros(n), np.ones(n), costs, np.full(n, ended), errors)


# settings


@cases(
    ("settings", "message"),
    [
        ({"scenario": "default"}, "scenario 'default' has no plan for the oracle.*--oracle 0"),
        ({"scenario": "flexx"}, "unknown scenario 'flexx'"),
        ({"satellite": "sputnik"}, "unknown satellite"),
        ({"inertia": "statis"}, "unknown inertia mode 'statis'"),
        ({"cost": -0.1}, "cost must be"),
        ({"cost": 1.5}, "cost must be"),
        ({"tuned": 0}, "tuned must be"),
        ({"episodes": 8, "oracle": 9}, "oracle must be at most 8"),
    ],
)
def test_bad_settings_are_refused_before_any_flight(settings, message):
    with pytest.raises(ValueError, match=message):
        Gate(**settings).check()


def test_good_settings_are_taken():
    Gate().check()
    Gate(scenario="default", oracle=0).check()
    with pytest.raises(ValueError, match="unknown inertia mode 'statis'"):
        RateLoopStudy(inertia="statis").check()


# what the oracle is told


def test_told_modes_are_those_of_the_plants():
    """Deflection over its limit, rate over that and the sheet's w, and frequency, for each episode's own sheet."""
    env = world()
    observation, _ = env.reset(seed=SEEDS)
    rng, place = np.random.default_rng(0), env.problem.layout["modes"]
    for _ in range(5):
        observation, *_ = env.step(rng.uniform(-0.5, 0.5, (3, 3)).astype(np.float32))
        told = with_true_modes(env, observation)
        part, o = told[:, place].astype(float), env.fleet.rows.plants["oscillators"]
        limit, w = env.fleet.rows.tasks["deflection_limit"][:, 0], env.fleet.rows.beliefs["modes"]["frequency"][:, 0]
        by_limit = part[:, AT["deflection_limit"]]
        q, speed = o["deflection"].mean(axis=1), o["speed"].mean(axis=1)
        np.testing.assert_allclose(part[:, AT["deflection"]] / by_limit, q / limit, rtol=1e-5)
        np.testing.assert_allclose(part[:, AT["deflection_rate"]] / by_limit, speed / limit / w, rtol=1e-5)
        changed = told != observation
        parts = ("deflection", "deflection_rate", "frequency", "frequency_std")
        pull = observation[:, place][:, AT["centrifugal"] :]
        pulled = AT["centrifugal"] + np.flatnonzero(pull.any(axis=0))
        assert set(np.flatnonzero(changed.any(axis=0)) - place.start) == {*(AT[name] for name in parts), *pulled}
        tangent, axis = np.cross(o["direction"][:, 0], o["arm"][:, 0]), o["direction"][:, 0]
        inertance = o["mass"][:, 0] * (tangent**2).sum(axis=1) + np.einsum(
            "ni,nij,nj->n", axis, o["inertia"][:, 0], axis
        )
        cycles = np.sqrt(o["stiffness"][:, 0] / inertance) / (2.0 * np.pi)  # a decision is a second
        np.testing.assert_allclose(part[:, AT["frequency"]], cycles, rtol=1e-6)
        slower = observation[:, place.start + AT["frequency"]] / cycles
        np.testing.assert_allclose(part[:, AT["centrifugal"] :], pull * slower[:, None] ** 2, rtol=1e-5)
        assert (part[:, AT["frequency_std"]] == -10.0).all()


def test_a_filter_that_knows_the_modes_observes_what_the_oracle_is_told():
    """With data sheets that are true, the filter's own deflection follows the truth, sign and scale."""
    own = SCENARIOS["flex"]
    exact = own.replace(appendages=own.appendages.replace(mass_std=0.0, frequency_std=0.0, damping_std=0.0))
    env, count = world(8, exact), 8
    observation, _ = env.reset(seed=list(range(count)))
    place = env.problem.layout["modes"]
    seen, told = [], []
    for step in range(40):
        side = 0.1 if step % 8 < 4 else -0.1
        observation, *_ = env.step(np.full((count, 3), side, np.float32))
        seen.append(observation[:, place])
        told.append(with_true_modes(env, observation)[:, place])
    seen, told = np.array(seen[20:]), np.array(told[20:])
    for name in ("deflection", "deflection_rate"):
        a, b = seen[:, :, AT[name]], told[:, :, AT[name]]
        assert np.abs(b).max() > 0.02
        assert (np.abs(a - b).max(axis=0) < 0.15 * np.abs(b).max(axis=0)).all(), name


def test_a_plan_reads_the_data_sheet_before_it_is_told_the_truth():
    env = world()
    first, _ = env.reset(seed=SEEDS)
    plan = ShapedPlan(POINTS)
    plan.reset(missions(env.problem)[0], SEEDS)
    plan(plan.told(env, first))
    w, size = np.moveaxis(plan._modes.state(), 2, 0)
    told = plan.told(env, first)
    own = env.fleet.rows.beliefs["modes"]
    np.testing.assert_allclose(w, own["frequency"] * env.problem.scenario.decision_period, rtol=1e-6)
    np.testing.assert_allclose(size[:, 0], np.linalg.norm(own["coupling"][:, 0], axis=1), rtol=1e-6)
    part = told[:, env.problem.layout["modes"]]
    assert (np.abs(2.0 * np.pi * part[:, AT["frequency"]] / w[:, 0] - 1.0) > 1e-3).all(), "the truth differs"


def test_the_told_sky_is_that_of_the_plants():
    """Sun and Earth in the body frame, also before the first reading; nothing else is changed."""
    env = world(4, "calibration")
    observation, _ = env.reset(seed=list(range(4)))
    for _ in range(2):
        told, plants = with_true_sky(env, observation), env.fleet.rows.plants
        angle = plants["orbit_rate"] * plants["time"]
        for k, plant in enumerate(plants):
            to_inertial = Rotation.from_quat(plant["attitude"])
            sky = {"sun": plant["tracker"]["sun"], "earth": [np.cos(angle[k]), np.sin(angle[k]), 0.0]}
            for name, direction in sky.items():
                seen = told[k, env.problem.layout[name]]
                np.testing.assert_allclose(to_inertial.apply(seen), direction, atol=1e-6)
        places = [env.problem.layout[name] for name in ("sun", "earth")]
        for place in places:
            told[:, place] = observation[:, place]
        np.testing.assert_array_equal(told, observation)
        observation, *_ = env.step(np.full((4, 3), 0.1, np.float32))
    env.close()


def test_a_plan_of_swings_has_settings_of_its_own_for_each_episode():
    env = world(3, "calibration")
    points = np.zeros((3, SwingPlan.size))
    points[1, 0] = np.log(2.0)  # of the swing
    points[2, 3:6] = -10.0  # of the amplitudes
    plan = SwingPlan(points)
    plan.reset(missions(env.problem)[0], SEEDS)
    observation, _ = env.reset(seed=SEEDS)
    told = plan.told(env, observation)
    told[:, env.problem.layout["earth"]] = told[:, env.problem.layout["sun"]] = -plan._boresight
    actions = np.array([plan(told) for _ in range(14)])
    swung = (np.abs(actions) > 0.1).any(axis=2).sum(axis=0)
    np.testing.assert_array_equal(swung, [12, 14, 0])
    env.close()


def test_a_plan_of_corners_without_preference_is_corner_tour():
    """But for the modes that it is told, and with the same caution."""
    env = world(3, "slosh")
    plan, tour = CornerPlan(np.zeros((3, CornerPlan.size))), CornerTourPolicy(caution=0.0)
    observation, _ = env.reset(seed=SEEDS)
    for policy in (plan, tour):
        policy.reset(missions(env.problem)[0], SEEDS)
    for _ in range(60):
        action = plan(observation)
        np.testing.assert_array_equal(action, tour(observation))
        observation, *_ = env.step(action)
    env.close()


def test_a_plan_of_corners_takes_the_corner_that_it_prefers_in_a_leg():
    env = world(3, "slosh")
    points = np.zeros((3, CornerPlan.size))
    preference = points.reshape(3, -1, 8)
    preference[0, 0, 5] = preference[1, 0, 0] = 1e4  # by far above any wait
    plan = CornerPlan(points)
    plan.reset(missions(env.problem)[0], SEEDS)
    observation, _ = env.reset(seed=SEEDS)
    assert plan.told(env, observation) is observation, "the first has the data sheet"
    taken = []
    for _ in range(60):
        action = plan(observation)
        taken.append(np.sign(action) @ [2.0, 1.0, 0.5] + 3.5)  # number of the corner
        observation = plan.told(env, env.step(action)[0])
    taken = np.array(taken)
    np.testing.assert_array_equal(taken[0, :2], [5, 0])
    assert all(len(np.unique(own)) > 4 for own in taken[1:].T), "after it the preference is over"
    env.close()


def test_a_factor_on_all_rotors_is_in_no_error():
    """The tensor in units of the rotors' mean inertia is what an estimate can be compared with."""
    env = world(4, "calibration", observation="wheels")
    env.reset(seed=list(range(4)))
    plants, reports = env.fleet.rows.plants, env.fleet.rows.reports
    factor = (plants["wheel_inertia"] / SATELLITES["microsat"].wheels.inertia).mean(axis=1)
    assert np.abs(factor - 1.0).max() > 1e-4
    reports["inertia_estimate"] = reports["inertia_true"] / factor[:, None, None]
    np.testing.assert_allclose(unit_free_error(env.fleet), 0.0, atol=1e-12)
    reports["inertia_estimate"] *= 1.01
    np.testing.assert_allclose(unit_free_error(env.fleet), 0.01, rtol=1e-9)
    env.close()


def test_a_plan_flies_the_same_alone_as_in_a_batch():
    plan = ShapedPlan(POINTS)
    together = flown(CELL, plan, SEEDS, plan.told)
    for i in (1, 2):
        plan = ShapedPlan(POINTS[[i]])
        alone = flown(CELL, plan, SEEDS[i : i + 1], plan.told)
        for name in ("expected", "error", "costs"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(together, name)[i], err_msg=name)
    assert len(set(together.expected)) == 3


# flights


def test_expected_error_is_that_of_the_filters_covariance():
    """Geometric mean of the moments' standard deviations over their prior means, from the determinant of theta."""
    env, policy = world(2, observation="wheels"), ZeroPolicy()
    env.reset(seed=[3, 4])
    expected = []
    for _ in range(env.problem.scenario.decisions):
        env.step(np.zeros((2, 3), np.float32))
        belief = env.fleet.rows.beliefs
        det = np.linalg.det(belief["covariance"][:, 3:6, 3:6]) / belief["prior_theta"].prod(axis=1) ** 2
        expected.append(det ** (1.0 / 6.0))
    found = flown(CELL, policy, [3, 4])
    np.testing.assert_allclose(found.expected, np.mean(expected, axis=0), rtol=1e-9)
    assert (found.expected < SCENARIOS["flex"].prior_std).all()


def test_what_ends_early_costs_what_it_cost_while_it_flew():
    flight = flown(CELL, RandomPolicy(), SEEDS)
    ended = flight.terminated
    assert ended.any()
    assert np.isinf(flight.expected[ended]).all()
    assert np.isfinite(flight.expected[~ended]).all()
    np.testing.assert_array_equal(flight.costs[:, COSTS.index("saturation")], 0.0)
    assert (flight.costs[:, COSTS.index("deflection")] > 0.0).all()
    assert (flight.costs <= 1.0).all()
    assert not flight.inside(1.0), "whatever the costs"


def test_inside_is_by_the_mean_of_each_cost_and_only_where_nothing_ended():
    costs = np.zeros((2, len(COSTS)))
    costs[:, 1] = 0.0, 0.02
    quiet, ended = np.zeros(2, bool), np.array([False, True])
    flight = Flown(np.ones(2), np.ones(2), np.ones(2), costs, quiet, np.ones(2))
    assert flight.inside(0.01)
    assert not flight.inside(0.009)
    assert not Flown(np.ones(2), np.ones(2), np.ones(2), costs, ended, np.ones(2)).inside(0.01)


# rivals


def test_a_quieter_policy_observes_what_the_policy_does():
    class Asks(ZeroPolicy):
        observation, include_covariance = "body", True

    for policy in (Asks(), ShapedSquarePolicy(), RateSquarePolicy(24.0, 3.5)):
        assert observation_settings(Quieter(policy, 0.5)) == observation_settings(policy)


def test_of_settings_inside_the_best_is_chosen_else_the_one_that_strays_least(monkeypatch):
    flights = {
        "good": scored(0.02, 0.03),
        "better": scored(0.01, 0.02),
        "best but outside": scored(0.001, 0.001, cost=0.02),
        "ends": scored(np.inf, np.inf, ended=True),
        "far outside": scored(0.001, 0.001, cost=0.3),
    }
    monkeypatch.setattr(rivals, "flown", lambda cell, policy, seeds, num_threads: flights[policy])
    trials = [({"number": float(i)}, name) for i, name in enumerate(flights)]
    assert choose(CELL, trials, 0.01, 2)[1] == "better"
    assert choose(CELL, trials[2:], 0.01, 2)[1] == "best but outside"
    assert choose(CELL, trials[3:], 0.01, 2)[1] == "far outside", "nothing of it ended"


# the gate


def test_the_oracle_is_compared_over_the_episodes_that_it_flew():
    oracle, rival = scored(1.0, 3.0), scored(2.0, 4.0, 50.0, 60.0)
    assert over(rival, oracle) == 1.5
    assert over(scored(2.0, np.inf, 1.0), oracle) is None
    own = row(Gate(), ("rival", {}, rival, 1.0), oracle)
    assert own["over_oracle"] == 1.5
    assert own["expected"] == 29.0
    assert row(Gate(), ("rival", {}, rival, 1.0), None)["over_oracle"] is None


def test_ratios_are_shown(capsys):
    best, other = list(PROFILES)[:2]
    flights = {
        best: scored(0.02),
        other: scored(0.03),
        "rate_square": scored(0.04),
        "shaped_square": scored(0.015, cost=0.5),
        "oracle": scored(0.01),
    }
    show([row(Gate(), (name, {}, flight, 1.0), flights["oracle"]) for name, flight in flights.items()])
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith("best of the eight 2.000, rate_square 4.000, shaped_square not inside")


@pytest.fixture
def still(tmp_path):
    """A saved network that observes the flexible body and commands no rate."""
    size = world().single_observation_space.shape[0]
    network = Network((np.zeros((3, size), np.float32),), (np.zeros(3, np.float32),))
    LearnedPolicy("still", network, "rate", 2.75, observation="body").save(tmp_path / "still")
    return str(tmp_path / "still")


def test_a_learned_policy_that_cannot_fly_here_is_refused_before_any_flight(still):
    for policies, message in [
        (["nobody"], "unknown policy"),
        (["generalist"], "policy generalist takes observations of 70 numbers"),
        ([f"sine={still}"], "the name 'sine' is taken: give the policy another"),
        ([still, still], "the name 'still' is taken"),
    ]:
        with pytest.raises(ValueError, match=message):
            Gate(policies=tuple(policies)).check()
    Gate(policies=(still,)).check()


def test_a_tiny_gate_from_end_to_end(still, tmp_path, monkeypatch, capsys):
    few = {
        "zero": [({}, ZeroPolicy())],
        "sine": [({"amplitude": a}, ScriptedPolicy("sine", PROFILES["sine"], a)) for a in (0.02, 0.05)],
        "rate_square": [({"amplitude": 0.05}, Quieter(RateSquarePolicy(48.0, 3.5), 0.05))],
        "shaped_square": [({"period": 24.0}, ShapedSquarePolicy())],
    }
    monkeypatch.setattr(gates, "rivals", lambda scenario: few)
    monkeypatch.setattr(gates, "search", functools.partial(search, population=2, rounds=1))
    gate = Gate(tuned=2, episodes=3, oracle=2, policies=(f"mine={still}",), output=tmp_path / "gate.json")
    assert gates.main(gate) == 0
    rows = {own["policy"]: own for own in json.loads((tmp_path / "gate.json").read_text())["rows"]}
    assert list(rows) == [*few, "mine", "oracle"]
    assert [own["episodes"] for own in rows.values()] == [3, 3, 3, 3, 3, 2]
    assert rows["mine"]["expected"] == rows["zero"]["expected"], "what it saw of the mode made no difference"
    assert rows["oracle"]["over_oracle"] == 1.0
    assert rows["zero"]["inside"]
    assert rows["zero"]["expected"] > 3.0 * rows["shaped_square"]["expected"]
    assert ", mine " in capsys.readouterr().out.splitlines()[-1]
