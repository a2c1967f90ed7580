"""PPO of Stable-Baselines3, beside which the other libraries' are put.

PYTHONPATH=. python examples/trainers/ppo_sb3.py
"""

from excitation import CLIP, ENVS, EPOCHS, GAE_LAMBDA, GAMMA, HIDDEN, LEARNING_RATE, LOG_STD, MINIBATCHES, ROLLOUT
from excitation import TASK, Learned, command
from stable_baselines3 import PPO

from agents.training.clocks import set_clocks
from satid_gym.sb3 import RateCommandVecEnv


def train(steps, seed):
    """The policy after so many decisions."""
    env = RateCommandVecEnv(ENVS, margin=2.6, stagger=True, **TASK)  # a margin of 2.6 is 97 to 98 % of the limit
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
    for net in (model.policy.mlp_extractor.policy_net, model.policy.mlp_extractor.value_net):
        set_clocks(net[0], env.vector_env.problem)
    env.seed(seed)
    model.learn(steps)
    return Learned(lambda observations: model.predict(observations, deterministic=True)[0])


if __name__ == "__main__":
    command(train, "Stable-Baselines3")
