"""PPO with a Lagrange multiplier for each cost that has a limit, in one file, through Safety-Gymnasium's interface.

Ray, Achiam and Amodei, Benchmarking Safe Exploration in Deep Reinforcement Learning, 2019. A satellite with panels,
which fast changes of rate set swinging: the reward has no penalty, so that plain PPO (--no-limits) bends them too far.

PYTHONPATH=. python examples/trainers/lagrangian_ppo.py
PYTHONPATH=. python examples/trainers/lagrangian_ppo.py --scenario slosh --limits deflection=0.01 --save runs/slosh
"""

import argparse
import time
from pathlib import Path

import excitation as task
import numpy as np
import torch
from excitation import network, updates

from baselines.command.provenance import revision
from satid_gym import SatInertiaIDVectorEnv
from satid_gym.evaluation import seeds
from satid_gym.metrics import final_error
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.safety import SafetyVectorEnv

LIMITS = {"deflection": 0.01, "rate": 0.01}  # of the decisions' mean costs
WORLD = {"satellite": "microsat", "inertia": "static", "scenario": "flex", "control": "rate", "observation": "body"}
UNPUNISHED = dict.fromkeys(("envelope_weight", "deflection_weight", "avoided_band_weight", "saturation_weight"), 0.0)
MULTIPLIER_RATE = 0.1  # of a multiplier in an update, by the cost over its limit less 1, at most 1
PROPORTION = 1.0  # of what a cost is beyond its limit now, which damps how multiplier and cost swing about each other
LOG_STD = (-1.5, -2.5)  # of exploration, first and last: it ends as nearly the mean action that is flown afterwards


def train(steps, seed, limits=LIMITS, constrained=True, world=WORLD):
    """The actor after `steps` decisions, and a row (decisions, costs, multipliers) for each update."""
    torch.manual_seed(seed)
    vector = SatInertiaIDVectorEnv(task.ENVS, reward=UNPUNISHED, autoreset_mode="SameStep", stagger=True, **world)
    env = SafetyVectorEnv(vector, limits)
    most = torch.tensor(list(limits.values()), dtype=torch.float32)
    multipliers = torch.zeros(len(limits))
    # the critic's first value is of the reward, the others are of the costs
    actor, critic = network(env, 3, 0.01), network(env, 1 + len(limits), 1.0)
    parameters = [*actor.parameters(), *critic.parameters()]
    optimizer = torch.optim.Adam(parameters, task.LEARNING_RATE, eps=1e-5)

    observations = torch.empty(task.ROLLOUT, task.ENVS, env.single_observation_space.shape[0])
    actions = torch.empty(task.ROLLOUT, task.ENVS, 3)
    log_probs, dones = torch.empty(2, task.ROLLOUT, task.ENVS)
    signals, values = torch.empty(2, task.ROLLOUT, task.ENVS, 1 + len(limits))
    observation = torch.as_tensor(env.reset(seed=task.first_seed(seed))[0])
    curve = []

    for update in range(updates(steps)):
        std = float(np.exp(np.interp(update, (0, updates(steps)), LOG_STD)))
        optimizer.param_groups[0]["lr"] = task.LEARNING_RATE * (1.0 - update / updates(steps))
        for t in range(task.ROLLOUT):
            with torch.no_grad():
                explored = torch.distributions.Normal(actor(observation), std)
                observations[t], actions[t] = observation, explored.sample()
                log_probs[t] = explored.log_prob(actions[t]).sum(-1)
                values[t] = critic(observation)
            following, reward, cost, terminated, truncated, _ = env.step(task.commanded(actions[t].numpy()))
            observation = torch.as_tensor(following)
            signals[t] = torch.as_tensor(np.column_stack([reward, cost]))
            dones[t] = torch.as_tensor(terminated | truncated)

        costs = signals[..., 1:].mean((0, 1))
        beyond = costs / most - 1.0
        if constrained:
            multipliers = (multipliers + MULTIPLIER_RATE * beyond.clamp(max=1.0)).clamp(min=0.0)
        curve.append(((update + 1) * task.ROLLOUT * task.ENVS, costs.tolist(), multipliers.tolist()))

        advantages = torch.empty_like(signals)
        with torch.no_grad():
            next_value, advantage = critic(observation), torch.zeros(task.ENVS, 1 + len(limits))
        for t in reversed(range(task.ROLLOUT)):
            goes_on = 1.0 - dones[t][:, None]
            error = signals[t] + task.GAMMA * goes_on * next_value - values[t]
            advantage = error + task.GAMMA * task.GAE_LAMBDA * goes_on * advantage
            advantages[t], next_value = advantage, values[t]
        returns = advantages + values
        weights = multipliers + constrained * PROPORTION * beyond.clamp(0.0, 5.0)
        lagrangian = advantages[..., 0] - (advantages[..., 1:] * weights).sum(-1)

        flat = [x.flatten(0, 1) for x in (observations, actions, log_probs, lagrangian, returns)]
        for _ in range(task.EPOCHS):
            for batch in torch.randperm(task.ROLLOUT * task.ENVS).chunk(task.MINIBATCHES):
                seen, taken, log_prob, advantage_of, return_of = (x[batch] for x in flat)
                advantage_of = (advantage_of - advantage_of.mean()) / (advantage_of.std() + 1e-8)
                now = torch.distributions.Normal(actor(seen), std)
                ratio = (now.log_prob(taken).sum(-1) - log_prob).exp()
                clipped = ratio.clamp(1.0 - task.CLIP, 1.0 + task.CLIP)
                policy_loss = -torch.min(ratio * advantage_of, clipped * advantage_of).mean()
                value_loss = (critic(seen) - return_of).square().mean()
                optimizer.zero_grad()
                (policy_loss + 0.5 * value_loss).backward()
                torch.nn.utils.clip_grad_norm_(parameters, 0.5)
                optimizer.step()
    env.close()
    return actor, curve


def scores(actor, limits=LIMITS, episodes=64, world=WORLD):
    """Final error, share of episodes that ended early, and mean costs, by name, on validation seeds."""
    env = SafetyVectorEnv(SatInertiaIDVectorEnv(episodes, reward=UNPUNISHED, **world), limits)
    observation, info = env.reset(seed=seeds("validation", episodes))
    alive, errors, costs = np.ones(episodes, bool), [info["relative_error"]], []
    for _ in range(env.unwrapped.problem.scenario.decisions):
        with torch.no_grad():
            action = actor(torch.as_tensor(observation)).numpy()
        observation, _, cost, terminated, _, info = env.step(task.commanded(action))
        costs.append(cost[alive])
        errors.append(np.where(alive, info["relative_error"], errors[-1]))
        alive &= ~terminated
    env.close()
    means = dict(zip(limits, np.concatenate(costs).mean(axis=0).tolist(), strict=True))
    final = final_error(np.array(errors[1:]))  # after each decision
    return {"final_error": float(final.mean()), "ended": float(1.0 - alive.mean()), **means}


def policy(actor, name, details):
    """The actor as a policy for `find`, `fly` and every command, with the rate loop's margin in place of `SHARE`."""
    return LearnedPolicy(
        name, Network.of_layers(actor), "rate", task.MARGIN, details=details, observation=WORLD["observation"]
    )


def limit(text):
    """Name and value of NAME=VALUE."""
    name, value = text.split("=")
    if not 0.0 < float(value) <= 1.0:
        raise ValueError
    return name, float(value)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=800_000, help="decisions, all environments together")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="of environments, networks and exploration")
    parser.add_argument("--no-limits", action="store_true", help="plain PPO: the same without multipliers")
    for name in ("scenario", "satellite", "inertia"):
        parameter = {"default": WORLD[name], "help": "as of the environment, by name or file (%(default)s)"}
        parser.add_argument(f"--{name}", **parameter)
    parser.add_argument(
        "--limits", type=limit, nargs="+", default=list(LIMITS.items()), metavar="NAME=VALUE", help="of mean costs"
    )
    parser.add_argument("--save", type=Path, help="save each policy as PATH-SEED.safetensors and PATH-SEED.json")
    options = parser.parse_args()
    limits = dict(options.limits)
    world = {**WORLD, **{name: getattr(options, name) for name in ("scenario", "satellite", "inertia")}}
    torch.set_num_threads(1)
    print("| PPO | seed | decisions | " + " | ".join(f"{name}, %" for name in limits) + " | multipliers |")
    for seed in options.seeds:
        start = time.perf_counter()
        actor, curve = train(options.steps, seed, limits, not options.no_limits, world)
        seconds = time.perf_counter() - start
        name = "plain" if options.no_limits else "Lagrangian"
        for decisions, costs, multipliers in curve[:: max(1, len(curve) // 8)]:
            numbers = [f"{100 * cost:.2f}" for cost in costs] + [" ".join(f"{m:.2f}" for m in multipliers)]
            print(f"| {name} | {seed} | {decisions} | {' | '.join(numbers)} |")
        found = " ".join(f"{score} {100 * value:.3f} %" for score, value in scores(actor, limits, world=world).items())
        print(f"{name}, seed {seed}, validation: {found}; {seconds:.0f} s, revision {revision()}", flush=True)
        if options.save:
            path = options.save.with_name(f"{options.save.name}-{seed}")
            trained = {"method": "lagrangian_ppo.py", "world": world, "limits": limits, "steps": options.steps}
            policy(actor, path.name, {"trained": {**trained, "seed": seed, "revision": revision()}}).save(path)
