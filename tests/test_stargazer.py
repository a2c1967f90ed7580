"""Policy of scenario "calibration": switches, commands that are repeated, and what is shipped."""

from __future__ import annotations

import numpy as np
import pytest

from agents.training.graph.export import graph
from agents.training.ppo import PPOSettings
from agents.training.sac import SACSettings
from agents.training.sb3.switches import SwitchedVecEnv, commands, with_switches
from agents.training.train import named
from satid_gym.policies import find
from satid_gym.policies.learned import LearnedPolicy, Network
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


def test_episodes_that_start_staggered_end_with_a_step():
    """Of five environments three would begin 2, 7 and 9 decisions late."""
    env = SwitchedVecEnv(5, repeat=4, stagger=True, **SETTINGS)
    env.seed(7)
    env.reset()
    decision, left = env.vector_env.fleet.rows.tasks["decision"], env.vector_env.problem.layout["time_left"]
    assert decision.tolist() == [0, 0, 4, 4, 8]
    for step in range(1, 7):
        observation, _, dones, infos = env.step(np.zeros((5, 4), int))
        np.testing.assert_array_equal(decision, (4 * step + np.array([0, 0, 4, 4, 8])) % 12)
        np.testing.assert_array_equal(dones, decision == 0)
        np.testing.assert_array_equal(observation[dones, left], 1.0)
        assert all(infos[i]["terminal_observation"][left] == 0.0 for i in np.flatnonzero(dones))
    env.close()


def test_what_follows_an_episode_that_ends_within_a_step_begins_with_a_command():
    one, many = RateCommandVecEnv(2, **SETTINGS), SwitchedVecEnv(2, repeat=4, **SETTINGS)
    for env in (one, many):
        env.seed(7)
        env.reset()
        env.vector_env.fleet.rows.tasks["termination_rate"][1] = 0.0  # of this episode
    switches = np.ones((2, 4), int)
    first = one.step(commands(switches))
    observation, reward, dones, infos = many.step(switches)
    assert dones.tolist() == [False, True]
    assert reward[1] == first[1][1]
    np.testing.assert_array_equal(infos[1]["terminal_observation"], first[3][1]["terminal_observation"])
    assert infos[1]["episode"]["l"] == 1
    assert many.vector_env.fleet.rows.tasks["decision"].tolist() == [4, 0]
    assert observation[1, many.vector_env.problem.layout["time_left"]] == 1.0
    paid = np.zeros(2)
    for step in range(3):
        _, reward, dones, infos = many.step(switches)
        paid += reward
        assert dones.tolist() == [step == 1, step == 2]
    assert infos[1]["episode"]["l"] == 12
    assert infos[1]["episode"]["r"] == pytest.approx(paid[1], rel=1e-5)
    for env in (one, many):
        env.close()


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


def test_the_shipped_policy_is_of_the_named_settings():
    policy = find("stargazer")
    trained = policy.details["trained"]["settings"]  # settings that came later have their defaults
    reward = trained["reward"] | {"avoided_band_weight": 10.0}
    assert trained | {"spares_modes": False, "reversals": False, "reward": reward} == named("stargazer").to_dict()
    assert policy.repeat == named("stargazer").repeat
    assert observation_settings(policy)["observation"] == "body"


def test_onnx_refuses_a_policy_that_repeats_its_commands():
    policy = find("stargazer")
    with pytest.raises(ValueError, match="a graph without memory"):
        graph(policy, only_mission(problem("microsat", "static", "calibration", control="rate", observation="body")))
