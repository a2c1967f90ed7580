"""Recurrent PPO of sb3-contrib: an LSTM before the policy, none before the value.

PYTHONPATH=. python examples/trainers/ppo_recurrent.py
"""

import excitation as task
import numpy as np
from excitation import Learned, command
from sb3_contrib import RecurrentPPO

from satid_gym.sb3 import RateCommandVecEnv


class Recurrent(Learned):
    """Policy with a memory that begins again with each flight."""

    def __init__(self, model):
        super().__init__(self._act)
        self.model = model

    def reset(self, mission, seeds):
        """Forget the flight before."""
        self.state, self.begins = None, np.ones(len(seeds), bool)

    def _act(self, observations):
        actions, self.state = self.model.predict(observations, self.state, self.begins, deterministic=True)
        self.begins = np.zeros(len(observations), bool)
        return actions


def train(steps, seed):
    """The policy after `steps` decisions."""
    env = RateCommandVecEnv(task.ENVS, margin=task.MARGIN, stagger=True, **task.TASK)
    model = RecurrentPPO(
        "MlpLstmPolicy",
        env,
        n_steps=task.ROLLOUT,
        batch_size=task.ENVS * task.ROLLOUT // task.MINIBATCHES,
        n_epochs=task.EPOCHS,
        gamma=task.GAMMA,
        gae_lambda=task.GAE_LAMBDA,
        clip_range=task.CLIP,
        learning_rate=lambda left: left * task.LEARNING_RATE,  # with a constant one it unlearns now and then
        policy_kwargs={
            "net_arch": list(task.HIDDEN),
            "lstm_hidden_size": 64,
            "enable_critic_lstm": False,
            "log_std_init": task.LOG_STD,
        },
        seed=seed,
        device="cpu",
    )
    env.seed(task.first_seed(seed))  # after the model, which has seeded the environments in its own way
    model.learn(steps)
    return Recurrent(model)


if __name__ == "__main__":
    command(train, "sb3-contrib, recurrent")
