"""PPO of skrl on the native vector environment.

PYTHONPATH=. python examples/trainers/ppo_skrl.py
"""

import excitation as task
import torch
from excitation import Excitation, Learned, command, network, updates
from gymnasium.vector import AutoresetMode
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed


class Policy(GaussianMixin, Model):
    """Mean and standard deviation of the actions."""

    def __init__(self, spaces, net):
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.net, self.log_std = net, torch.nn.Parameter(torch.full((3,), task.LOG_STD))

    def compute(self, inputs, role):
        """Mean (N, 3), and the logarithm of the standard deviation."""
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    """Value of observations."""

    def __init__(self, spaces, net):
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = net

    def compute(self, inputs, role):
        """Values (N, 1)."""
        return self.net(inputs["observations"]), {}


def train(steps, seed):
    """The policy after `steps` decisions."""
    set_seed(seed)
    vector = Excitation(AutoresetMode.SAME_STEP, seed)
    env = wrap_env(vector)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    policy, value = Policy(spaces, network(vector, 3, 0.01)), Value(spaces, network(vector, 1, 1.0))
    settings = PPO_CFG(
        rollouts=task.ROLLOUT,
        learning_epochs=task.EPOCHS,
        mini_batches=task.MINIBATCHES,
        discount_factor=task.GAMMA,
        gae_lambda=task.GAE_LAMBDA,
        learning_rate=task.LEARNING_RATE,
        ratio_clip=task.CLIP,
        value_clip=0.0,
        value_loss_scale=0.5,
    )
    settings.experiment.write_interval = settings.experiment.checkpoint_interval = 0
    agent = PPO(
        models={"policy": policy, "value": value},
        memory=RandomMemory(memory_size=task.ROLLOUT, num_envs=task.ENVS, device=env.device),
        cfg=settings,
        **spaces,
    )
    trainer = {"timesteps": updates(steps) * task.ROLLOUT, "headless": True, "disable_progressbar": True}
    trainer["close_environment_at_exit"] = False
    SequentialTrainer(env=env, agents=agent, cfg=trainer).train()
    env.close()
    return Learned.of(policy.net)


if __name__ == "__main__":
    command(train, "skrl")
