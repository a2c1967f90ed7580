"""PPO of Stable-Baselines3, next to which the other libraries' are put.

PYTHONPATH=. python examples/trainers/ppo_sb3.py
"""

import excitation as task
from excitation import Learned, command
from stable_baselines3 import PPO

from agents.training.clocks import set_clocks
from satid_gym.sb3 import RateCommandVecEnv


def train(steps, seed):
    """The policy after `steps` decisions."""
    env = RateCommandVecEnv(task.ENVS, margin=task.MARGIN, stagger=True, **task.TASK)
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=task.ROLLOUT,
        batch_size=task.ENVS * task.ROLLOUT // task.MINIBATCHES,
        n_epochs=task.EPOCHS,
        gamma=task.GAMMA,
        gae_lambda=task.GAE_LAMBDA,
        clip_range=task.CLIP,
        learning_rate=task.LEARNING_RATE,
        policy_kwargs={"net_arch": list(task.HIDDEN), "log_std_init": task.LOG_STD},
        seed=seed,
        device="cpu",
    )
    for net in (model.policy.mlp_extractor.policy_net, model.policy.mlp_extractor.value_net):
        set_clocks(net[0], env.vector_env.problem)
    env.seed(task.first_seed(seed))  # after the model, which has seeded the environments in its own way
    model.learn(steps)
    return Learned(lambda observations: model.predict(observations, deterministic=True)[0])


if __name__ == "__main__":
    command(train, "Stable-Baselines3")
