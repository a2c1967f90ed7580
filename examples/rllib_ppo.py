"""Train PPO of Ray's RLlib by body rates, stop, go on, and fly what it learned against scripted excitation.

From the checkout, with pip install ".[reach]": PYTHONPATH=. python examples/rllib_ppo.py
"""

import sys
import tempfile
from pathlib import Path

import ray
import torch
from ray.rllib.algorithms.ppo import PPO, PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policies import make_baseline
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.rllib import ArrayEnvRunner, learned_policy

torch.set_num_threads(1)  # the network is small: a second thread only takes cores from the environments
ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")

world = {
    "satellite": "microsat",
    "control": "rate",  # actions are body rates; the environment's rate loop turns them into torque
    "include_covariance": True,
    "reward": {"held_reference": 22.0},  # what is paid for is information held
    "stagger": True,  # so that a rollout holds every part of an episode
}
config = (
    PPOConfig()
    .environment("satid_gym:SatInertiaID-v0", env_config=world)
    .env_runners(
        num_env_runners=0,
        num_envs_per_env_runner=64,
        rollout_fragment_length=50,
        gym_env_vectorize_mode="vector_entry_point",
        env_runner_cls=ArrayEnvRunner,  # without it RLlib's own, which loops over the environments in Python
    )
    .training(
        train_batch_size=64 * 50,
        minibatch_size=800,
        num_epochs=5,
        gamma=0.9,
        lr=1e-3,
        use_kl_loss=False,
        vf_clip_param=float("inf"),
        clip_param=0.2,
    )
    .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], vf_share_layers=False, free_log_std=True))
    .debugging(seed=0, log_level="ERROR")
)
UPDATES = int(sys.argv[1]) if sys.argv[1:] else 40  # of 3200 decisions, before and after the stop


def train(algorithm: PPO) -> float:
    """Mean return of the last episodes, after `UPDATES` iterations."""
    for _ in range(UPDATES):
        result = algorithm.train()
    return result["env_runners"]["episode_return_mean"]


with tempfile.TemporaryDirectory() as folder:
    algorithm = config.build_algo()
    returns = [train(algorithm)]
    algorithm.save_to_path(folder)
    algorithm.stop()
    algorithm = PPO.from_checkpoint(folder)
    returns.append(train(algorithm))
    print(f"mean return {returns[0]:.0f} after {UPDATES} updates, {returns[1]:.0f} after as many again")
    # our format: no Ray is needed to fly it, and `python -m agents.compare --policies PATH` takes it
    path = Path(folder) / "rllib_ppo"
    learned_policy("rllib_ppo", algorithm.get_module(), control="rate", margin=1.0, include_covariance=True).save(path)
    mine = LearnedPolicy.load(path)
    algorithm.stop()
ray.shutdown()

# The same 16 episodes for everybody, on seeds that training never saw.
cell = {"satellite": "microsat", "inertia": "random", "seeds": seeds("validation", 16)}
errors = {}
for policy in (mine, *(make_baseline(name, "microsat") for name in ("sine", "staggered_square", "rate_square"))):
    scores = fly(policy, scenario=benchmark_scenario(), **cell).scores()
    errors[policy.name] = scores["final_error"].mean()
    print(f"{policy.name:17s} final error {errors[policy.name]:.3%}, outside {scores['outside_fraction'].mean():.1%}")
