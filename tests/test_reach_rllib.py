"""RLlib: our env runner against RLlib's own, episode by episode and in what is learned, and its modules as policies."""

from __future__ import annotations

import time
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest

ray = pytest.importorskip("ray")

import torch
from ray.rllib.algorithms.ppo import PPO, PPOConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.connectors.env_to_module import FlattenObservations, MeanStdFilter
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner

from satid_gym import SatInertiaIDVectorEnv
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.rllib import ArrayEnvRunner, learned_policy

pytestmark = pytest.mark.reach
ROOT = Path(__file__).parents[1]
WORLD = {"control": "rate", "stagger": True, "max_episode_steps": 12}
EPISODE = "episode_return_mean", "episode_return_min", "episode_return_max", "num_episodes", "num_env_steps_sampled"


@pytest.fixture(scope="module", autouse=True)
def _cluster():
    torch.set_num_threads(1)
    ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield
    ray.shutdown()


def config(runner=ArrayEnvRunner, *, envs=6, steps=20, world=WORLD, own=None, **model):
    layers = {"fcnet_hiddens": [16, 16], "free_log_std": True, "vf_share_layers": False}
    return (
        PPOConfig()
        .environment("satid_gym:SatInertiaID-v0", env_config=world)
        .env_runners(
            num_envs_per_env_runner=envs,
            rollout_fragment_length=steps,
            gym_env_vectorize_mode="vector_entry_point",
            env_runner_cls=runner,
            **{"num_env_runners": 0, **(own or {})},
        )
        .training(train_batch_size=envs * steps, minibatch_size=40, num_epochs=2, gamma=0.9, lr=1e-2)
        .rl_module(model_config=DefaultModelConfig(**{**layers, **model}))
        .debugging(seed=3, log_level="ERROR")
    )


def both(**settings):
    return SingleAgentEnvRunner(config=config(None, **settings)), ArrayEnvRunner(config=config(**settings))


def columns(episode):
    """All numbers of an episode or chunk, without the lookback that RLlib's own has."""
    outputs = {name: episode.get_extra_model_outputs(name) for name in episode.extra_model_outputs}
    steps = {"obs": episode.get_observations(), "actions": episode.get_actions(), "rewards": episode.get_rewards()}
    return {**steps, **outputs}


def check_same(own, ours, exactly=True):
    """Episodes of two runners: the same, in the same order."""
    for one, other in zip_longest(own, ours):
        other.validate()
        for name in ("t_started", "t", "is_terminated", "is_truncated", "is_numpy"):
            assert getattr(one, name) == getattr(other, name), name
        expected, found = columns(one), columns(other)
        assert expected.keys() == found.keys()
        for name, values in expected.items():
            np.testing.assert_array_equal(values, found[name], err_msg=name)
            assert values.dtype == found[name].dtype, name
        if one.is_done:
            assert one.get_infos(-1)["relative_error"] == other.get_infos(-1)["relative_error"]
            assert one.get_infos(-1)["costs"] == other.get_infos(-1)["costs"]


# episodes


@pytest.mark.parametrize("call", [{}, {"explore": False}, {"random_actions": True}, {"num_timesteps": 7}])
def test_chunks_are_those_of_rllibs_own_runner(call):
    """Three calls, over which episodes of 12 steps go on and end, some at the last step of a call."""
    sampled = []
    for runner in both():
        torch.manual_seed(0)
        runner.env.action_space.seed(0)
        sampled.append([runner.sample(**call) for _ in range(4)])
        runner.stop()
    for own, ours in zip(*sampled, strict=True):
        check_same(own, ours)
    assert any(episode.is_done for ours in sampled[1] for episode in ours)


def test_whole_episodes_are_those_of_rllibs_own_runner():
    """From the seed's reset on, as an evaluation asks for them; a chunk in between is dropped."""
    sampled = []
    for runner in both():
        torch.manual_seed(0)
        sampled.append([runner.sample(num_episodes=4), runner.sample(num_episodes=7), runner.sample(num_timesteps=30)])
        assert runner.get_metrics()["num_episodes"].peek() == 11 + sum(e.is_done for e in sampled[-1][2])
        runner.stop()
    for own, ours in zip(*sampled, strict=True):
        check_same(own, ours)
    assert [len(ours) for ours in sampled[1][:2]] == [4, 7]


def test_chunks_of_an_episode_follow_each_other_and_its_return_counts_all_of_them():
    runner = ArrayEnvRunner(config=config())
    chunks = {}
    for _ in range(5):
        for episode in runner.sample(num_timesteps=30):
            chunks.setdefault(episode.id_, []).append(episode)
    returns = []
    for first, *others in chunks.values():
        assert first.t_started == 0
        for other in others:
            first.concat_episode(other)
        if first.is_done:
            returns.append(first.get_return())
    metrics = runner.get_metrics()
    assert metrics["episode_return_mean"].peek() == pytest.approx(np.mean(returns))
    assert metrics["episode_return_max"].peek() == pytest.approx(np.max(returns))
    assert metrics["episode_len_max"].peek() == 12
    assert metrics["num_env_steps_sampled_lifetime"].peek() == sum(len(parts[0]) for parts in chunks.values())
    runner.stop()


def test_an_environment_that_fails_is_made_anew(monkeypatch):
    own = config()
    own.fault_tolerance(restart_failed_sub_environments=True)
    runner = ArrayEnvRunner(config=own)
    step, left = SatInertiaIDVectorEnv.step, [9]

    def failing(env, actions):
        left[0] -= 1
        if left[0] == 0:
            raise FloatingPointError("a filter broke down")
        return step(env, actions)

    monkeypatch.setattr(SatInertiaIDVectorEnv, "step", failing)
    episodes = runner.sample(num_timesteps=60)
    assert left[0] < 0
    assert 60 <= sum(map(len, episodes)) < 66  # some of the six only reset in the last step
    assert all(episode.t_started == 0 for episode in episodes)
    runner.stop()


# learning


def learned(algorithm):
    return {name: value.copy() for name, value in algorithm.get_module().get_state().items()}


def test_ppo_learns_the_same_as_with_rllibs_own_runner(tmp_path):
    """Three updates, bit for bit: values at truncations and cuts, advantages and minibatches are the same."""
    weights, scores = [], []
    for runner in (None, ArrayEnvRunner):
        algorithm = config(runner).build_algo()
        for _ in range(3):
            result = algorithm.train()
        weights.append(learned(algorithm))
        scores.append([result["env_runners"][name] for name in EPISODE])
        algorithm.stop()
    for name, expected in weights[0].items():
        np.testing.assert_array_equal(expected, weights[1][name], err_msg=name)
    np.testing.assert_allclose(scores[0], scores[1], rtol=1e-12)


def test_a_saved_algorithm_goes_on_and_evaluates_whole_episodes(tmp_path):
    world = {**WORLD, "stagger": False}
    own = config(world=world).evaluation(evaluation_num_env_runners=0, evaluation_duration=6, evaluation_interval=1)
    algorithm = own.build_algo()
    algorithm.train()
    algorithm.save_to_path(tmp_path)
    before = learned(algorithm)
    algorithm.stop()
    algorithm = PPO.from_checkpoint(str(tmp_path))
    for name, expected in before.items():
        np.testing.assert_array_equal(expected, learned(algorithm)[name], err_msg=name)
    result = algorithm.train()
    assert result["training_iteration"] == 2
    assert result["env_runners"]["num_env_steps_sampled_lifetime"] >= 240
    assert result["evaluation"]["env_runners"]["num_episodes"] == 6
    assert result["evaluation"]["env_runners"]["episode_len_mean"] == 12
    algorithm.stop()


def test_runners_in_processes_of_their_own():
    algorithm = config(own={"num_env_runners": 1}).build_algo()
    first, second = (algorithm.train()["env_runners"]["num_env_steps_sampled_lifetime"] for _ in range(2))
    assert second - 120 >= first >= 120
    algorithm.stop()


# what it refuses


class EachStep(RLlibCallback):
    def on_episode_step(self, **kwargs):
        raise AssertionError("called")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"own": {"env_to_module_connector": lambda env, spaces, device: FlattenObservations()}}, "connectors"),
        ({"use_lstm": True}, "recurrent"),
        ({"world": {**WORLD, "autoreset_mode": "SameStep"}}, "NEXT_STEP"),
        ({"callbacks": EachStep}, "on_episode_step"),
    ],
)
def test_what_takes_a_step_of_each_environment_is_refused(settings, said):
    callbacks = settings.pop("callbacks", None)
    own = config(**settings).callbacks(callbacks)
    with pytest.raises(ValueError, match=f"{said}.*env_runner_cls"):
        ArrayEnvRunner(config=own)


# speed


def test_it_is_several_times_as_fast():
    """Side by side in one run, by turns, the best of each.

    Of the thread that samples, time on a core: on a machine that nobody else uses that is wall time, of which other
    programs take more from the one that is fast, since its environments use all cores most of the time.
    """
    world = {"control": "rate", "include_covariance": True}
    for envs in (64, 256, 1024):
        runners = both(envs=envs, steps=20, world=world, fcnet_hiddens=[64, 64])
        env = runners[1].env
        actions = env.action_space.sample()
        calls = (*(runner.sample for runner in runners), lambda: [env.step(actions)] * envs)  # noqa: B023, called here
        best = np.full((3, 2), np.inf)  # microseconds a decision, of the thread and of wall time
        for _ in range(5):
            for i, call in enumerate(calls):
                start = np.array([time.thread_time(), time.perf_counter()])
                taken = sum(map(len, call())) if i < 2 else len(call())
                best[i] = np.minimum(best[i], 1e6 * ([time.thread_time(), time.perf_counter()] - start) / taken)
        for runner in runners:
            runner.stop()
        ratio, wall = best[0] / best[1]
        own, ours, alone = best[:, 0]
        print(
            f"{envs} environments: {own:.1f} us by RLlib's own runner, {ours:.1f} us by ArrayEnvRunner, of which the "
            f"environments {alone:.1f}; {ratio:.1f} times as fast, {wall:.1f} in wall time"
        )
        assert ratio > 2.0


# policies


@pytest.mark.parametrize("normalise", [False, True])
@pytest.mark.parametrize("model", [{}, {"vf_share_layers": True, "free_log_std": False, "fcnet_activation": "relu"}])
def test_a_policy_acts_as_the_module(model, normalise, tmp_path):
    """On observations of episodes, to 1e-6, as RLlib's own runner acts without exploration."""
    connector = {"env_to_module_connector": lambda env, spaces, device: MeanStdFilter(clip_by_value=float("inf"))}
    runner = SingleAgentEnvRunner(config=config(None, own=connector if normalise else None, **model))
    runner.sample(num_timesteps=600)
    piece = runner._env_to_module[0] if normalise else None
    learned_policy("mine", runner.module, normalised=piece, control="rate").save(tmp_path / "mine")
    policy = LearnedPolicy.load(tmp_path / "mine")
    env = SatInertiaIDVectorEnv(6, **WORLD)
    observations, _ = env.reset(seed=5)
    recorded = [observations]
    for _ in range(10):
        recorded.append(env.step(env.action_space.sample())[0])
    recorded = np.concatenate(recorded)
    seen = recorded
    if normalise:
        seen = np.stack([piece._filters[None](row.astype(float), update=False) for row in recorded])
    module = runner.module.double()
    outputs = module.forward_inference({Columns.OBS: torch.from_numpy(seen.astype(float))})
    means = outputs[Columns.ACTION_DIST_INPUTS][:, :3].numpy()
    np.testing.assert_allclose(policy.network(recorded), means, atol=1e-6)
    assert np.abs(means).max() > 1e-3
    runner.stop()


def test_a_module_that_is_no_policy_is_refused():
    runner = ArrayEnvRunner(config=config(fcnet_use_layernorm=True))
    with pytest.raises(ValueError, match="linear layers alone"):
        learned_policy("mine", runner.module, control="rate")
    runner.stop()
    runner = SingleAgentEnvRunner(
        config=config(None, own={"env_to_module_connector": lambda env, spaces, device: MeanStdFilter()})
    )
    with pytest.raises(ValueError, match="clip_by_value=float"):
        learned_policy("mine", runner.module, normalised=runner._env_to_module[0], control="rate")
    runner.stop()
