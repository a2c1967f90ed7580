"""PPO in one file, in the style of CleanRL: read from top to bottom, torch alone, the native vector environment.

Schulman et al., Proximal Policy Optimization Algorithms, 2017.

PYTHONPATH=. python examples/trainers/ppo_one_file.py
"""

import excitation as task
import torch
from excitation import Excitation, Learned, command, network, updates
from gymnasium.vector import AutoresetMode


def train(steps, seed):
    """The policy after `steps` decisions."""
    torch.manual_seed(seed)
    # the observation after an episode's last decision is the first of the next episode
    env = Excitation(AutoresetMode.SAME_STEP, seed)
    actor, critic = network(env, 3, 0.01), network(env, 1, 1.0)
    log_std = torch.nn.Parameter(torch.full((3,), task.LOG_STD))
    parameters = [*actor.parameters(), *critic.parameters(), log_std]
    optimizer = torch.optim.Adam(parameters, task.LEARNING_RATE, eps=1e-5)

    observations = torch.empty(task.ROLLOUT, task.ENVS, env.single_observation_space.shape[0])
    actions = torch.empty(task.ROLLOUT, task.ENVS, 3)
    log_probs, rewards, dones, values = torch.empty(4, task.ROLLOUT, task.ENVS)
    observation = torch.as_tensor(env.reset()[0])

    for _ in range(updates(steps)):
        for t in range(task.ROLLOUT):
            with torch.no_grad():
                explored = torch.distributions.Normal(actor(observation), log_std.exp())
                observations[t], actions[t] = observation, explored.sample()
                log_probs[t] = explored.log_prob(actions[t]).sum(-1)
                values[t] = critic(observation)[:, 0]
            following, reward, done, _, _ = env.step(actions[t].numpy())
            observation = torch.as_tensor(following)
            rewards[t], dones[t] = torch.as_tensor(reward), torch.as_tensor(done)

        advantages = torch.empty_like(rewards)
        with torch.no_grad():
            next_value, advantage = critic(observation)[:, 0], torch.zeros(task.ENVS)
        for t in reversed(range(task.ROLLOUT)):
            goes_on = 1.0 - dones[t]
            error = rewards[t] + task.GAMMA * goes_on * next_value - values[t]
            advantage = error + task.GAMMA * task.GAE_LAMBDA * goes_on * advantage
            advantages[t], next_value = advantage, values[t]
        returns = advantages + values

        flat = [x.flatten(0, 1) for x in (observations, actions, log_probs, advantages, returns)]
        for _ in range(task.EPOCHS):
            for batch in torch.randperm(task.ROLLOUT * task.ENVS).chunk(task.MINIBATCHES):
                seen, taken, log_prob, advantage_of, return_of = (x[batch] for x in flat)
                advantage_of = (advantage_of - advantage_of.mean()) / (advantage_of.std() + 1e-8)
                now = torch.distributions.Normal(actor(seen), log_std.exp())
                ratio = (now.log_prob(taken).sum(-1) - log_prob).exp()
                clipped = ratio.clamp(1.0 - task.CLIP, 1.0 + task.CLIP)
                policy_loss = -torch.min(ratio * advantage_of, clipped * advantage_of).mean()
                value_loss = (critic(seen)[:, 0] - return_of).square().mean()
                optimizer.zero_grad()
                (policy_loss + 0.5 * value_loss).backward()
                torch.nn.utils.clip_grad_norm_(parameters, 0.5)
                optimizer.step()
    env.close()
    return Learned.of(actor)


if __name__ == "__main__":
    command(train, "one file, as CleanRL")
