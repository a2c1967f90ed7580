"""Tours of the rate envelope's corners: the forecast of bending, the law, the learned score and its evolution."""

from __future__ import annotations

import dataclasses
import json
from contextlib import closing

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from agents.evolution import corners
from agents.evolution.corners import main
from agents.evolution.judge import Judge, Judges, expected_relative_error
from agents.evolution.settings import Evolution
from baselines.command.cli import UserError
from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.tune import tuned_rival
from satid_gym.control.corners.features import features_of
from satid_gym.control.corners.tour import CornerTour
from satid_gym.control.observed_modes import Modes, ObservedModes
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.evaluation import fly, seeds
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.learned.shipped import find
from satid_gym.policies.registry import build
from satid_gym.policy import only_mission
from satid_gym.problem import problem
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.vector import SatInertiaIDVectorEnv

GIVEN = {"satellite": "microsat", "inertia": "static", "scenario": "slosh", "control": "rate", "observation": "body"}
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
STEP = 0.25  # s, a quarter of a decision


def observed() -> ObservedModes:
    return ObservedModes([only_mission(problem(**GIVEN))], 0.9, 1.0)


def modes(w: float, d: np.ndarray, rate: np.ndarray, eta: float, speed: float, limit: float) -> Modes:
    """One episode with one mode; w in rad/s, d per rate limit, speed over w."""
    size = np.linalg.norm(d)
    return Modes(
        rate=rate[None],
        most=np.full((1, 3), 10.0),
        swing=np.array([[[eta, speed]]]),
        direction=(d / size)[None, None],
        bent=np.array([[size / w**2]]),  # a decision is a second
        turn=np.array([[[np.cos(w * STEP), np.sin(w * STEP)]]]),
        turned=np.array([[w]]),
        limit=np.array([[limit]]),
        pull=np.zeros((1, 1, 6)),
    )


@pytest.mark.parametrize("w", [0.15, 0.4, 0.6])
def test_bending_is_foreseen_as_the_oscillator_moves(w):
    """eta'' = -w^2 eta - d . domega/dt where the rate follows the command as a first-order lag."""
    rng, d = np.random.default_rng(1), np.array([0.3, -0.6, 0.2])
    bandwidth = problem(**GIVEN).scenario.tracking_bandwidth
    for _ in range(5):
        rate, command = rng.uniform(-1.0, 1.0, 3), rng.choice([-1.0, 1.0], 3)

        def move(t: float, state: np.ndarray, rate=rate, command=command) -> list[float]:
            turning = bandwidth * (command - rate) * np.exp(-bandwidth * t)
            return [state[1], -w * w * state[0] - d @ turning]

        solved = solve_ivp(move, (0.0, 300.0), [0.1, 0.02], rtol=1e-9, atol=1e-9, max_step=0.2)
        found = observed().peaks(modes(w, d, rate, 0.1, 0.02 / w, 2.0), command[None, None])[0, 0]
        assert found == pytest.approx(np.abs(solved.y[0]).max() / 2.0, rel=0.05)


def test_what_can_follow_a_turn_is_all_that_is_asked_of_it():
    """By complex numbers, one rotation a step: the command for one decision, then each of the others for eight."""
    own, rng = observed(), np.random.default_rng(2)
    lag = 1.0 - np.exp(-problem(**GIVEN).scenario.tracking_bandwidth * STEP)
    given = modes(0.3, np.array([0.2, 0.5, -0.4]), rng.uniform(-1.0, 1.0, 3), 0.3, -0.2, 1.5)
    turn = np.exp(-1j * 0.3 * STEP)

    def steps(rate: np.ndarray, state: complex, command: np.ndarray, count: int) -> tuple[np.ndarray, complex, float]:
        peak = 0.0
        for _ in range(count):
            change = lag * (command - rate)
            centre = -given.bent[0, 0] / STEP * (given.direction[0, 0] @ change)
            rate, state = rate + change, centre + (state - centre) * turn
            peak = max(peak, abs(state.real) / 1.5)
        return rate, state, peak

    expected = []
    for corner in CORNERS:
        rate, state, first = steps(given.rate[0], complex(*given.swing[0, 0]), corner, 4)
        ends = [steps(rate, state, after, 32) for after in CORNERS]
        expected.append(max(first, min(max(peak, abs(end) / 1.5) for _, end, peak in ends)))
    np.testing.assert_allclose(own.peaks_of_turns(given, CORNERS[None])[0], expected, rtol=1e-12)


def test_a_satellite_whose_modes_are_not_estimated_is_refused():
    with pytest.raises(ValueError, match='such as "momentum"'):
        build("corner_tour", {}).reset(only_mission(problem(**GIVEN, estimator="rate")), [0])


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_corner_tour_keeps_the_limit_and_expects_less_than_square_waves(satellite):
    cell = Cell(scenario="slosh", satellite=satellite, inertia="static")
    tour, spared = (flown(cell, build(name, {}), seeds("validation", 16)) for name in ("corner_tour", "spared_square"))
    assert tour.inside(0.01)
    assert 0.3 < tour.nees.mean() < 2.0
    assert tour.expected.mean() < 0.95 * spared.expected.mean()


def test_where_no_corner_is_open_the_one_that_bends_least_is_taken(monkeypatch):
    env = SatInertiaIDVectorEnv(4, **GIVEN)
    tour = CornerTour([only_mission(env.problem)], 3.5)
    tour.begin(4)
    observation, _ = env.reset(seed=0)
    peak = 1.5 + np.random.default_rng(3).permuted(np.tile(np.arange(8.0), (4, 1)), axis=1)
    monkeypatch.setattr(ObservedModes, "peaks_of_turns", lambda self, modes, choices, decisions=1: peak)
    np.testing.assert_array_equal(np.sign(tour(observation)), CORNERS[np.argmin(peak, axis=1)])
    env.close()


def scored(*features: str, **given) -> LearnedPolicy:
    """A policy whose score is the sum of some features."""
    network = Network((np.ones((1, len(features)), np.float32),), (np.zeros(1, np.float32),))
    return LearnedPolicy(
        "toured", network, "rate", 3.5, **({"observation": "body", "corner_features": features} | given)
    )


def test_a_network_of_the_waits_flies_as_the_baseline_and_goes_through_its_file(tmp_path):
    scored("waited").save(tmp_path / "toured")
    policy = LearnedPolicy.load(tmp_path / "toured")
    assert policy.corner_features == ("waited",)
    assert not policy.is_shaped
    scored("waited", is_shaped=True).save(tmp_path / "shaped")
    assert LearnedPolicy.load(tmp_path / "shaped").is_shaped
    cell = Cell(scenario="slosh", satellite="microsat", inertia="periodic")
    found, expected = (flown(cell, own, seeds("validation", 3)) for own in (policy, build("corner_tour", {})))
    np.testing.assert_array_equal(found.expected, expected.expected)


def test_a_network_that_does_not_fit_corners_is_refused():
    with pytest.raises(ValueError, match="1 features of corners"):
        scored("waited", observation="wheels")
    network = Network((np.zeros((3, 5), np.float32),), (np.zeros(3, np.float32),))
    with pytest.raises(ValueError, match="2 features of corners"):
        LearnedPolicy("odd", network, "rate", 3.5, observation="body", corner_features=("waited", "gain"))
    with pytest.raises(ValueError, match="is_shaped is of policies that score corners"):
        LearnedPolicy("odd", Network((np.zeros((3, 40), np.float32),), (np.zeros(3, np.float32),)), "rate", 3.5,
            observation="body", is_shaped=True)  # fmt: skip
    with pytest.raises(ValueError, match="at most once"):
        scored("waited", "waited")
    with pytest.raises(ValueError, match="wated"):
        scored("wated")
    with pytest.raises(ValueError, match="include_walk=True"):
        fly(scored("waited", "any_walk"), satellite="microsat", inertia="static", seeds=[0], control="rate")


def test_the_walk_of_the_inertia_decides_where_it_alone_scores():
    """Observed walks are logarithms; below 0 a reversal is worth less than none, above it more."""
    env = SatInertiaIDVectorEnv(2, "microsat", "static", control="rate", observation="body", include_walk=True)
    observation, _ = env.reset(seed=seeds("validation", 2))
    observation[:, env.problem.layout["inertia_walk"]] = [[-1.0], [1.0]]
    tour = CornerTour([only_mission(env.problem)], 3.5, features=("any_walk",))
    tour.begin(2)
    stays, reverses = tour(observation, scored("any_walk", include_walk=True).score)
    assert (stays > 0.0).all()
    assert (reverses < 0.0).any()
    env.close()


SMALL = Evolution(satellites=("microsat",), generations=3, population=4, episodes=2, validation=1)
SHORT = dataclasses.replace(SMALL, horizon=30.0)


def test_a_stopped_evolution_goes_on_to_the_same_policy(tmp_path, capsys):
    whole, halves = (dataclasses.replace(SHORT, output=tmp_path / name) for name in ("whole", "halves"))
    assert main(whole) == 0
    assert main(dataclasses.replace(halves, generations=1, workers=1)) == 0
    assert main(halves) == 0
    assert capsys.readouterr().out.count("periodic") == 3
    for name in ("curve.csv", "policy.safetensors"):
        assert (tmp_path / "halves" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_generations_that_are_kept_say_which_revision_flew_them(tmp_path, monkeypatch, capsys):
    run, files = dataclasses.replace(SHORT, generations=1, output=tmp_path), tmp_path / "generations.npz"

    def continued(generations: int, now: str) -> tuple[list[str], str]:
        monkeypatch.setattr(corners, "revision", lambda: now)
        assert main(dataclasses.replace(run, generations=generations)) == 0
        return json.loads((tmp_path / "policy.json").read_text())["training"]["revisions"], capsys.readouterr().out

    revisions, said = continued(1, "aaa")
    assert revisions == ["aaa"]
    assert "has generations" not in said
    revisions, said = continued(2, "bbb")
    assert revisions == ["aaa", "bbb"]
    assert f"{tmp_path} has generations of revision aaa, this is bbb: to start again, give another --output" in said
    with np.load(files) as kept:
        assert kept["revisions"].tolist() == ["aaa", "bbb"]
        np.savez(files, **{name: kept[name] for name in ("settings", "asked", "judged")})
    assert continued(2, "bbb")[0] == ["unknown"], "of files of before"
    with pytest.raises(UserError, match="other settings: give another --output"):
        main(dataclasses.replace(run, episodes=3))
    with np.load(files) as kept:
        np.savez(files, **{**kept, "asked": kept["asked"] + 1.0})
    with pytest.raises(UserError, match="this version of cma would not try"):
        main(run)
    files.write_bytes(files.read_bytes()[:300])
    with pytest.raises(UserError, match=r"generations\.npz is damaged"):
        main(run)


def test_what_bends_the_tank_too_far_is_judged_worse():
    small = dataclasses.replace(SMALL, episodes=8)
    judge = Judge(small, *small.worlds)
    waits, never = (
        np.array([sign * (name == own) for name in SMALL.features]) for own, sign in (("waited", 1.0), ("any", -1.0))
    )
    assert judge(waits, 0) < judge(-never, 0) - 1.0
    judge.close()
    with pytest.raises(ValueError, match="scenario"):
        Evolution(scenarios=("slosh", "slush"))


def test_each_scenario_counts_as_much():
    both = dataclasses.replace(SMALL, scenarios=("default", "slosh"), generations=1, workers=1)
    weights = both.first
    own = []
    for world in both.worlds:
        judge = Judge(both, world)
        own.append(judge(weights, 0))
        judge.close()
    with closing(Judges(both)) as judges:
        assert judges([weights], 0) == [pytest.approx(np.mean(own))]
    assert set(both.features) == {*features_of(SCENARIOS["default"]), *SMALL.features}
    for scenarios in (("default", "operations"), ("slosh", "calibration")):
        with pytest.raises(ValueError, match=f"all have a star tracker or none.*; {scenarios[0]} has none"):
            dataclasses.replace(SMALL, scenarios=scenarios)


def test_drawn_satellites_are_judged_by_the_error_of_the_tensor(tmp_path, capsys):
    """What the filter expects of it, against tensors drawn from the filter's belief."""
    small = Evolution(name="any", scenarios=("default",), satellites=("drawn",), drawn=3, generations=1, population=4)
    small = dataclasses.replace(small, episodes=3, validation=1, horizon=30.0, output=tmp_path)
    assert main(small) == 0
    assert capsys.readouterr().out.count("drawn_2") == 32
    env = SatInertiaIDVectorEnv(2, small.flies("tuning", 2), "static", control="rate", observation="body")
    env.reset(seed=0)
    for side in (1.0, -1.0, 1.0):
        env.step(side * np.array([[0.5, 0.3, -0.6], [0.4, -0.5, 0.2]]))
    rng = np.random.default_rng(8)
    for belief, found in zip(env.fleet.rows.beliefs, expected_relative_error(env), strict=True):
        mean = belief["mean"][3:9]
        errors = inertia_tensors(rng.multivariate_normal(np.zeros(6), belief["covariance"][3:9, 3:9], 20_000))
        size = np.linalg.norm(inertia_tensors(mean))
        np.testing.assert_allclose(found, np.sqrt(np.mean(np.linalg.norm(errors, axis=(1, 2)) ** 2)) / size, rtol=0.03)
    env.close()


@pytest.mark.compiled
@pytest.mark.parametrize("inertia", ["static", "periodic"])
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_shipped_tour_expects_less_than_the_law_it_began_as(satellite, inertia):
    cell, those = Cell(scenario="slosh", satellite=satellite, inertia=inertia), seeds("validation", 24)
    learned, law = (flown(cell, policy, those) for policy in (find("tank_tour"), build("corner_tour", {})))
    assert learned.inside(0.01)
    assert 0.3 < learned.nees.mean() < 2.0
    assert learned.expected.mean() < law.expected.mean()


@pytest.mark.compiled
@pytest.mark.parametrize("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_tour_of_any_satellite_expects_less_than_square_waves(satellite):
    cell, those = Cell(scenario="default", satellite=satellite, inertia="static"), seeds("validation", 16)
    _, square = tuned_rival("default", "microsat", "rate_square")
    learned, waves = (flown(cell, policy, those) for policy in (find("rigid_tour"), square))
    assert learned.inside(0.01)
    assert 0.3 < learned.nees.mean() < 2.0
    assert learned.expected.mean() < waves.expected.mean()
