"""Policy of scenario "calibration": switches, commands that are repeated, the comparison, and what is shipped."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from agents.training.graph.export import graph
from agents.training.ppo import PPOSettings
from agents.training.sac import SACSettings
from agents.training.sb3.switches import SwitchedVecEnv, commands, with_switches
from agents.training.train import named
from baselines.scenarios import compare
from baselines.scenarios.compare import Comparison, against
from baselines.scenarios.flights import Cell, flown
from satid_gym.evaluation import seeds
from satid_gym.flightcode.policy_source import policy_source
from satid_gym.policies import find
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.network import Network
from satid_gym.policies.reference import ZeroPolicy
from satid_gym.policies.shipped import RATE_PRETRAINED
from satid_gym.policy import observation_settings, only_mission
from satid_gym.problem import problem
from satid_gym.sb3 import RateCommandVecEnv
from tests.cases import cases

SHORT = {"name": "default", "horizon": 12.0}
SETTINGS = {"satellite": "microsat", "scenario": SHORT, "control": "rate", "observation": "body", "margin": 3.5}


def logits(size: int = 5, seed: int = 0) -> Network:
    rng = np.random.default_rng(seed)
    shapes = [(8, size), (4, 8)]
    weights = tuple(rng.standard_normal(shape).astype(np.float32) for shape in shapes)
    return Network(weights, tuple(rng.standard_normal(shape[0]).astype(np.float32) for shape in shapes))


def test_layers_of_switches_give_the_rates_of_the_likelier_positions():
    network, seen = logits(), np.random.default_rng(1).standard_normal((500, 5))
    found = network(seen)
    clear = (np.abs(found) > 0.3).all(axis=1)
    assert clear.sum() > 50
    rates = np.array([[0.0] * 3 if rest > 0 else np.sign(sides) for *sides, rest in found[clear]])
    assert {0.0, 1.0, -1.0} == set(np.unique(rates))
    np.testing.assert_allclose(with_switches(network)(seen)[clear], rates, atol=1e-3)
    np.testing.assert_array_equal(commands((found[clear] > 0).astype(int)), rates)


def test_switches_follow_a_network_of_tanh_with_four_outputs():
    network = logits()
    for wrong in (Network(network.weights, network.biases, "relu"), Network(network.weights[:1], network.biases[:1])):
        with pytest.raises(ValueError, match="network of tanh with 4 outputs"):
            with_switches(wrong)


def test_a_step_of_switches_is_as_many_decisions_with_their_rewards():
    one, many = RateCommandVecEnv(3, **SETTINGS), SwitchedVecEnv(3, repeat=4, **SETTINGS)
    for env in (one, many):
        env.seed(7)
        env.reset()
    rng = np.random.default_rng(2)
    for step in range(6):  # two episodes
        switches = rng.integers(0, 2, (3, 4))
        total = np.zeros(3)
        for _ in range(4):
            expected, reward, dones, infos = one.step(commands(switches))
            total += reward
        observation, reward, ended, later = many.step(switches)
        np.testing.assert_array_equal(observation, expected)
        np.testing.assert_allclose(reward, total, rtol=1e-5)
        np.testing.assert_array_equal(ended, dones)
        assert ended.all() == (step in (2, 5))
        for own, theirs in zip(later, infos, strict=True):
            assert own.keys() == theirs.keys()
            if own:
                np.testing.assert_array_equal(own["terminal_observation"], theirs["terminal_observation"])
                assert own["episode"]["l"] == 12


def test_a_step_divides_the_episode():
    with pytest.raises(ValueError, match="repeat must divide the 12 decisions"):
        SwitchedVecEnv(1, repeat=5, **SETTINGS)


@cases(
    ("settings", "message"),
    [
        (lambda: PPOSettings(repeat=2), "add --switches"),
        (lambda: PPOSettings(repeat=0), "repeat"),
        (lambda: PPOSettings(switches=True, control="torque"), "--control rate and PPO"),
        (lambda: SACSettings(switches=True), "--control rate and PPO"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        settings()


def test_commands_are_repeated_also_after_saving(tmp_path):
    posed = problem("microsat", "static", control="rate", observation="body")
    size = max(place.stop for place in posed.layout.values())
    network = Network(
        (np.random.default_rng(3).standard_normal((3, size)).astype(np.float32),), (np.zeros(3, np.float32),)
    )
    seen = np.random.default_rng(4).standard_normal((9, 2, size)).astype(np.float32)
    every = LearnedPolicy("every", network, "rate", 3.5, observation="body")
    every.reset(only_mission(posed), [0, 1])
    decided = [every(row) for row in seen]
    LearnedPolicy("one", network, "rate", 3.5, observation="body", repeat=4).save(tmp_path / "one")
    policy = LearnedPolicy.load(tmp_path / "one")
    for _ in range(2):  # a flight begins with a decision
        policy.reset(only_mission(posed), [0, 1])
        for i, row in enumerate(seen):
            np.testing.assert_array_equal(policy(row), decided[i - i % 4])


def test_ratios_are_of_means_and_clear_by_the_paired_interval():
    episodes = np.linspace(1.0, 2.0, 40)
    lower, other = episodes - 0.1, episodes + 0.3 * (-1.0) ** np.arange(40)
    rows = [{"expected": values.tolist(), "error": values[::-1].tolist()} for values in (lower, episodes, other)]
    assert against(rows[0], rows[1])["expected"] == {"ratio": pytest.approx(1.4 / 1.5), "clear": -1}
    assert against(rows[1], rows[0])["error"] == {"ratio": pytest.approx(1.5 / 1.4), "clear": 1}
    assert against(rows[2], rows[1])["expected"]["clear"] == 0


def test_the_shipped_policy_beats_zero_and_stops(tmp_path, capsys):
    given = {"satellites": ("microsat",), "inertias": ("static",), "rivals": ("zero",), "split": "validation"}
    settings = Comparison(policy="stargazer", episodes=4, output=tmp_path / "found.json", **given)
    settings.check()
    assert compare.main(settings) == 0
    own, zero = json.loads((tmp_path / "found.json").read_text())["summary"]
    assert own["expected"] < 0.25 * zero["expected"]
    assert own["largest_cost"] <= 0.01
    assert own["first_over_it"]["expected"]["ratio"] == 1.0
    assert "zero" in capsys.readouterr().out
    direct = flown(
        Cell(scenario="calibration", satellite="microsat", inertia="static"), ZeroPolicy(), seeds("validation", 4)
    )
    assert zero["expected"] == pytest.approx(direct.expected.mean(), rel=1e-4)


def test_the_shipped_policy_is_of_the_named_settings():
    policy = find("stargazer")
    trained = policy.details["trained"]["settings"]  # settings that came later have their defaults
    assert trained | {"spares_modes": False, "reversals": False} == named("stargazer").to_dict()
    assert policy.repeat == named("stargazer").repeat
    assert observation_settings(policy)["observation"] == "body"


def test_c_and_onnx_refuse_a_policy_that_repeats_its_commands():
    policy = find("stargazer")
    with pytest.raises(ValueError, match="repeats each command for 10 decisions, and has no C"):
        policy_source(SimpleNamespace(policy=policy))
    with pytest.raises(ValueError, match="a graph without memory"):
        graph(policy, only_mission(problem("microsat", "static", "calibration", control="rate", observation="body")))


def test_a_rival_has_another_name():
    with pytest.raises(ValueError, match="NAME=PATH"):
        Comparison(policy=f"mpc={RATE_PRETRAINED / 'stargazer'}", rivals=("mpc",)).check()
