"""The adapter gives Stable-Baselines3 what the vector environment gives, as Stable-Baselines3 wants it."""

from functools import partial

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from stable_baselines3 import A2C, PPO, SAC, TD3
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize
from torch.nn import ReLU, Sigmoid

from satid_gym import SatInertiaIDVectorEnv
from satid_gym.evaluation import fly, seeds
from satid_gym.gym_api import COSTS
from satid_gym.policies import find
from satid_gym.policies.learned.from_sb3 import learned_policy
from satid_gym.policy import missions
from satid_gym.sb3 import RateCommandVecEnv, SatInertiaIDVecEnv
from tests.cases import cases

HORIZON = 7
RELU, SIGMOID = {"activation_fn": ReLU}, {"activation_fn": Sigmoid}


@pytest.fixture
def adapter():
    env = SatInertiaIDVecEnv(5, max_episode_steps=HORIZON)
    yield env
    env.close()


def test_steps_equal_the_vector_environment(adapter):
    vector = SatInertiaIDVectorEnv(5, max_episode_steps=HORIZON, autoreset_mode=AutoresetMode.SAME_STEP)
    adapter.seed(3)
    observations = adapter.reset()
    expected, _ = vector.reset(seed=3)
    np.testing.assert_array_equal(observations, expected)
    rng = np.random.default_rng(0)
    for _ in range(3 * HORIZON):
        actions = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
        observations, rewards, dones, infos = adapter.step(actions)
        expected, gained, terminated, truncated, vector_infos = vector.step(actions)
        np.testing.assert_array_equal(observations, expected)
        np.testing.assert_allclose(rewards, gained, rtol=1e-6)
        np.testing.assert_array_equal(dones, terminated | truncated)
        for i in np.flatnonzero(dones):
            np.testing.assert_array_equal(infos[i]["terminal_observation"], vector_infos["final_obs"][i])
        assert all(infos[i] == {} for i in np.flatnonzero(~dones))


def test_the_last_info_sums_the_episode_up(adapter):
    adapter.seed(0)
    adapter.reset()
    total = np.zeros(5)
    for _ in range(HORIZON):
        _, rewards, dones, infos = adapter.step(np.zeros((5, 3), np.float32))
        total += rewards
    assert dones.all()
    for info, episode_return in zip(infos, total, strict=True):
        assert info["episode"]["l"] == HORIZON
        assert info["episode"]["r"] == pytest.approx(episode_return, rel=1e-5)
        assert type(info["TimeLimit.truncated"]) is bool
        assert 0.0 < info["relative_error"] < 1.0


def test_the_last_info_has_the_mean_costs_of_the_episode():
    """A Lagrangian callback could not see a cost: infos had none."""
    settings = {"satellite": "cubesat", "max_episode_steps": 8}
    adapter = SatInertiaIDVecEnv(3, stagger=True, **settings)
    vector = SatInertiaIDVectorEnv(3, autoreset_mode=AutoresetMode.SAME_STEP, stagger=True, **settings)
    adapter.seed(7)
    adapter.reset()
    vector.reset(seed=7)
    flown, ends = [[] for _ in range(3)], 0
    actions = np.outer([0.02, 0.1, 0.2], [1.0, -1.0, 1.0]).astype(np.float32)  # some turn beyond their limit
    for t in range(24):
        _, _, dones, infos = adapter.step(actions)
        _, _, _, _, expected = vector.step(actions)
        for i in range(3):
            costs = (expected["final_info"] if dones[i] else expected)["costs"]
            assert {name: values[i] for name, values in adapter.costs.items()} == {
                name: costs[name][i] for name in COSTS
            }
            flown[i].append([costs[name][i] for name in COSTS])
            if dones[i]:
                np.testing.assert_allclose(list(infos[i]["costs"].values()), np.mean(flown[i], axis=0), rtol=1e-12)
                assert tuple(infos[i]["costs"]) == COSTS
                ends, flown[i] = ends + (infos[i]["costs"]["rate"] > 0.0), []
        if t == 10:  # in mid-episode
            state = adapter.state()
            adapter.reset()
            adapter.restore(state)
    assert ends >= 2


def test_rate_commands_before_reset_and_of_another_shape_are_refused():
    env = RateCommandVecEnv(4, satellite="microsat")
    with pytest.raises(ResetNeeded, match=r"call reset\(\)"):
        env.step(np.zeros((4, 3)))
    env.reset()
    with pytest.raises(ValueError, match=r"actions must have shape \(4, 3\), got \(3, 3\)"):
        env.step(np.zeros((3, 3)))


@pytest.mark.parametrize("bootstrap", [True, False])
def test_the_horizon_is_a_time_limit_only_where_asked(bootstrap):
    env = SatInertiaIDVecEnv(2, bootstrap=bootstrap, max_episode_steps=1)
    env.reset()
    _, _, dones, infos = env.step(np.zeros((2, 3), np.float32))
    assert dones.all()
    assert [info["TimeLimit.truncated"] for info in infos] == [bootstrap] * 2


@pytest.mark.parametrize("kind", [SatInertiaIDVecEnv, RateCommandVecEnv])
def test_the_spaces_of_one_environment_are_those_of_one(kind):
    env = kind(4, satellite="microsat")
    for name in ("action_space", "observation_space"):
        assert env.get_attr(name) == [getattr(env, name)] * 4
    assert env.get_attr("action_space", [1])[0].shape == (3,)
    assert env.get_attr("problem")[0] is env.vector_env.problem


def test_observations_do_not_change_after_they_are_given(adapter):
    first = adapter.reset()
    kept = first.copy()
    adapter.step(np.ones((5, 3), np.float32))
    np.testing.assert_array_equal(first, kept)


def test_staggered_episodes_end_at_different_steps():
    env = SatInertiaIDVecEnv(10, stagger=True, max_episode_steps=10)
    env.reset()
    ends = [env.step(np.zeros((10, 3), np.float32))[2].sum() for _ in range(10)]
    assert ends == [1] * 10


def test_a_restored_state_goes_on_as_the_original(adapter):
    adapter.seed(1)
    adapter.reset()
    actions = np.full((5, 3), 0.3, np.float32)
    adapter.step(actions)
    state = adapter.state()
    twin = SatInertiaIDVecEnv(5, max_episode_steps=HORIZON)
    twin.restore(state)
    for _ in range(2 * HORIZON):
        ours, theirs = adapter.step(actions), twin.step(actions)
        np.testing.assert_array_equal(ours[0], theirs[0])
        np.testing.assert_array_equal(ours[1], theirs[1])
        assert [i.get("episode", {}).get("r") for i in ours[3]] == [i.get("episode", {}).get("r") for i in theirs[3]]


def test_a_state_of_other_settings_is_refused(adapter):
    for other in (SatInertiaIDVecEnv(4), SatInertiaIDVecEnv(5, include_covariance=True)):
        other.reset()
        with pytest.raises(ValueError, match="other settings"):
            adapter.restore(other.state())


def test_what_compiled_environments_have_not_is_said(adapter):
    with pytest.raises(NotImplementedError, match="make a new vector"):
        adapter.set_attr("x", 1)
    with pytest.raises(NotImplementedError, match="vector_env"):
        adapter.env_method("reset")
    with pytest.raises(RuntimeError, match="step_async"):
        adapter.step_wait()
    assert adapter.env_is_wrapped(object) == [False] * 5


@pytest.mark.filterwarnings("error::UserWarning")  # Stable-Baselines3's, where it doubts the episodes' lengths
def test_evaluate_policy_on_a_fresh_vector_counts_whole_episodes():
    env = SatInertiaIDVecEnv(4, max_episode_steps=HORIZON)
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=64, device="cpu")
    evaluated = SatInertiaIDVecEnv(4, max_episode_steps=HORIZON)
    evaluated.seed(5)
    returns, lengths = evaluate_policy(model, evaluated, n_eval_episodes=8, return_episode_rewards=True)
    assert lengths == [HORIZON] * 8
    evaluated.seed(5)
    observations, total = evaluated.reset(), np.zeros(4)
    for _ in range(HORIZON):
        actions, _ = model.predict(observations, deterministic=True)
        observations, rewards, _, _ = evaluated.step(actions)
        total += rewards
    np.testing.assert_allclose(returns[:4], total, rtol=1e-5)


@pytest.mark.filterwarnings("error::UserWarning")
def test_the_first_evaluation_of_eval_callback_counts_whole_episodes(tmp_path):
    train, evaluated = (SatInertiaIDVecEnv(4, max_episode_steps=HORIZON) for _ in range(2))
    callback = EvalCallback(evaluated, n_eval_episodes=4, eval_freq=2, log_path=str(tmp_path), verbose=0)
    PPO("MlpPolicy", train, n_steps=4, batch_size=16, n_epochs=1, device="cpu").learn(16, callback=callback)
    assert np.load(tmp_path / "evaluations.npz")["ep_lengths"][0].tolist() == [HORIZON] * 4


@pytest.mark.compiled
def test_ppo_learns_through_it():
    model = PPO("MlpPolicy", SatInertiaIDVecEnv(8), n_steps=16, batch_size=64, n_epochs=1, device="cpu")
    model.learn(256)
    assert model.num_timesteps == 256


def trained(algorithm, env, **settings):
    return algorithm("MlpPolicy", env, device="cpu", seed=0, **settings).learn(100)


@cases(
    ("algorithm", "adapter", "settings"),
    [
        (PPO, partial(RateCommandVecEnv, margin=3.0, include_covariance=True), {"n_steps": 25}),
        (
            PPO,
            partial(SatInertiaIDVecEnv, observation="body"),
            {"n_steps": 25, "policy_kwargs": {"activation_fn": ReLU}},
        ),
        (A2C, partial(SatInertiaIDVecEnv, control="rate", observation="body"), {}),
        (SAC, RateCommandVecEnv, {"learning_starts": 20}),
    ],
)
def test_a_model_is_a_policy_that_flies_as_it_was_trained(algorithm, adapter, settings, tmp_path):
    env = adapter(4, satellite="microsat", inertia="static")
    model = trained(algorithm, env, **settings)
    policy = learned_policy(model, "mine")
    policy.save(str(tmp_path / "mine"))
    policy = find(str(tmp_path / "mine"))
    problem = env.vector_env.problem
    assert policy.observation == problem.observation
    assert policy.include_covariance == problem.include_covariance
    assert (policy.margin, policy.spares_modes) == (getattr(env, "margin", 0.0), getattr(env, "spares_modes", False))
    env.seed(7)
    observation = env.reset()
    policy.reset(missions(problem)[0], range(4))
    for _ in range(5):
        action, _ = model.predict(observation, deterministic=True)
        env.step_async(action)
        np.testing.assert_allclose(env._actions, np.clip(policy(observation), -1.0, 1.0), atol=2e-5)
        observation, *_ = env.step_wait()
    control = "rate" if problem.control == "rate" else "torque"
    scores = fly(policy, satellite="microsat", inertia="static", seeds=seeds("validation", 2), control=control).scores()
    assert np.isfinite(scores["final_error"]).all()


def test_a_model_that_is_no_policy_is_refused(tmp_path):
    env, untold = SatInertiaIDVecEnv(2, satellite="microsat"), tmp_path / "model.zip"
    trained(PPO, env, n_steps=50).save(untold)
    with pytest.raises(ValueError, match=r"model.zip is a model of Stable-Baselines3: make a policy of it"):
        find(str(untold))
    for make, message in [
        (lambda: trained(PPO, VecNormalize(env), n_steps=50), "VecNormalize changes the observations"),
        (lambda: trained(PPO, VecFrameStack(env, 2), n_steps=50), "VecFrameStack changes the observations"),
        (lambda: trained(TD3, env, learning_starts=20), "a model of TD3 cannot be used"),
        (
            lambda: trained(PPO, env, n_steps=50, policy_kwargs={"activation_fn": Sigmoid}),
            "activations Sigmoid cannot be used",
        ),
        (lambda: trained(PPO, "Pendulum-v1", n_steps=50), "environment of the model is DummyVecEnv"),
        (lambda: PPO.load(untold), "environment of the model is missing"),
    ]:
        with pytest.raises(ValueError, match=message):
            learned_policy(make())
