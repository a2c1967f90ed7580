"""PPO of Tianshou on the native vector environment.

PYTHONPATH=. python examples/trainers/ppo_tianshou.py
"""

import excitation as task
import numpy as np
import torch
from excitation import Excitation, Learned, command, network, updates
from gymnasium.vector import AutoresetMode
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import BaseVectorEnv
from tianshou.trainer import OnPolicyTrainerParams


class NativeVectorEnv(BaseVectorEnv):
    """A Gymnasium vector environment with autoreset disabled as Tianshou's, whose collector resets what has ended.

    The compiled vector steps all environments at once, as a collector of decisions (not of episodes) asks for.
    """

    def __init__(self, env):
        self.vector, self.env_num = env, env.num_envs
        self.ready_id, self.waiting_id, self.is_async, self.is_closed = list(range(self.env_num)), [], False, False

    def get_env_attr(self, key, id=None):
        """The attribute of the single environment, once for each index."""
        spaces = {"action_space": "single_action_space", "observation_space": "single_observation_space"}
        return [getattr(self.vector, spaces.get(key, key)) for _ in self._wrap_id(id)]

    def reset(self, env_id=None, **named):
        """Start an episode in the environments of these indices: observations and infos."""
        indices = np.asarray(self._wrap_id(env_id))
        mask = np.zeros(self.env_num, bool)
        mask[indices] = True
        observations, _ = self.vector.reset(options={"reset_mask": mask}, **named)
        return observations[indices], np.array([{} for _ in indices])

    def step(self, action, id=None):
        """Take one decision in every environment."""
        indices = list(self._wrap_id(id))
        if indices != list(range(self.env_num)):
            raise ValueError(f"expected all {self.env_num} rows, got {indices}: collect decisions, not episodes")
        observations, rewards, terminations, truncations, _ = self.vector.step(action)
        return observations, rewards, terminations, truncations, np.array([{"env_id": i} for i in indices])

    def close(self):
        """End the threads."""
        self.vector.close()
        self.is_closed = True


class Actor(torch.nn.Module):
    """Mean and standard deviation of the actions."""

    def __init__(self, net):
        super().__init__()
        self.net, self.log_std = net, torch.nn.Parameter(torch.full((3,), task.LOG_STD))

    def forward(self, obs, state=None, info=None):
        """Mean and standard deviation, (N, 3) each, and Tianshou's hidden state."""
        mean = self.net(torch.as_tensor(obs))
        return (mean, self.log_std.exp().expand_as(mean)), state


class Critic(torch.nn.Module):
    """Value of observations."""

    def __init__(self, net):
        super().__init__()
        self.net = net

    def forward(self, obs, act=None, info=None):
        """Values (N, 1)."""
        return self.net(torch.as_tensor(obs))


def normal(parameters):
    """Distribution of actions for what the actor gives."""
    return torch.distributions.Independent(torch.distributions.Normal(*parameters), 1)


def train(steps, seed):
    """The policy after `steps` decisions."""
    torch.manual_seed(seed)
    np.random.seed(seed)  # noqa: NPY002  # Tianshou shuffles with NumPy's global generator
    vector = Excitation(AutoresetMode.DISABLED, seed)
    actor = Actor(network(vector, 3, 0.01))
    policy = ProbabilisticActorPolicy(
        actor=actor,
        dist_fn=normal,
        action_space=vector.single_action_space,
        action_scaling=False,
        action_bound_method=None,
    )
    rollout = task.ENVS * task.ROLLOUT
    algorithm = PPO(
        policy=policy,
        critic=Critic(network(vector, 1, 1.0)),
        optim=AdamOptimizerFactory(lr=task.LEARNING_RATE, eps=1e-5),
        eps_clip=task.CLIP,
        gamma=task.GAMMA,
        gae_lambda=task.GAE_LAMBDA,
        vf_coef=0.5,
        ent_coef=0.0,
        max_grad_norm=0.5,
        max_batchsize=rollout,
    )
    algorithm.run_training(
        OnPolicyTrainerParams(
            training_collector=Collector(policy, NativeVectorEnv(vector), VectorReplayBuffer(rollout, task.ENVS)),
            max_epochs=1,
            epoch_num_steps=updates(steps) * rollout,
            collection_step_num_env_steps=rollout,
            update_step_num_repetitions=task.EPOCHS,
            batch_size=rollout // task.MINIBATCHES,
            show_progress=False,
            verbose=False,
        )
    )
    return Learned.of(actor.net)


if __name__ == "__main__":
    command(train, "Tianshou")
