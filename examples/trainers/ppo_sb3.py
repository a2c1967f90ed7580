"""PPO of Stable-Baselines3, beside which the other libraries' are put.

PYTHONPATH=. python examples/trainers/ppo_sb3.py --steps 400000
"""

import numpy as np
import torch
from excitation import CLIP, ENVS, EPOCHS, GAE_LAMBDA, GAMMA, HIDDEN, LEARNING_RATE, LOG_STD, MINIBATCHES, ROLLOUT
from excitation import SATELLITE, command
from stable_baselines3 import PPO

from satid_gym.sb3 import RateCommandVecEnv


def train(steps, seed):
    """What the policy does after so many decisions: actions (N, 3) for observations (N, size)."""
    torch.set_num_threads(1)
    env = RateCommandVecEnv(
        ENVS,
        margin=2.6,  # of the rate's noise: 97 to 98 % of the limit
        satellite=SATELLITE,
        control="rate",
        include_covariance=True,
        reward={"held_reference": 22.0},
        stagger=True,
    )
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=ROLLOUT,
        batch_size=ENVS * ROLLOUT // MINIBATCHES,
        n_epochs=EPOCHS,
        gamma=GAMMA,
        gae_lambda=GAE_LAMBDA,
        clip_range=CLIP,
        learning_rate=LEARNING_RATE,
        policy_kwargs={"net_arch": list(HIDDEN), "log_std_init": LOG_STD},
        seed=seed,
        device="cpu",
    )
    env.seed(seed)
    model.learn(steps)
    return lambda observations: model.predict(observations, deterministic=True)[0]


if __name__ == "__main__":
    command(train, "Stable-Baselines3")
