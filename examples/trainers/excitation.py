"""Task of the trainers in this folder: environments to train in, networks, and scores of what was learned.

Actions are body rates of the microsat as fractions of what may be commanded, observations hold the filter's whole
covariance, and the reward is large where the inertia is well known. Each trainer is one file with a command line.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorWrapper

import satid_gym  # noqa: F401  # registers SatInertiaID-v0
from agents.training.clocks import set_clocks
from baselines.command.provenance import revision
from satid_gym.evaluation import benchmark_scenario, fly, seeds

SHARE = 0.97  # of the rate limit may be commanded: the rate has noise about what is commanded
TASK: dict[str, Any] = {
    "satellite": "microsat",
    "control": "rate",
    "include_covariance": True,
    "reward": {"held_reference": 22.0},
}
MARGIN = 2.6  # of the rate's noise, where `RateCommandVecEnv` keeps it: 97 to 98 % of the limit
ENVS, ROLLOUT, EPOCHS, MINIBATCHES = 64, 50, 5, 4  # of PPO, in whatever library
GAMMA, GAE_LAMBDA, CLIP, LEARNING_RATE, LOG_STD = 0.9, 0.8, 0.2, 2e-3, 0.0
HIDDEN = (64, 64)  # units of the layers, tanh after each, of policy and value


class Excitation(VectorWrapper):
    """The satellite, many times, with the first reset of a given seed: libraries seed differently or not at all.

    The first episodes have less time left, evenly spread (`stagger`), so that a rollout holds every part of an episode.
    The horizon is the end of the task, and the policy observes the time left, so it is reported as termination: no
    library adds the value of a state after it.

    Args:
        autoreset_mode: what the library expects of the environments.
        seed: of the training; the first reset has `first_seed` of it, later ones go on from there.
        num_envs: how many.
    """

    def __init__(self, autoreset_mode: str | AutoresetMode, seed: int, num_envs: int = ENVS) -> None:
        super().__init__(
            gymnasium.make_vec(
                "SatInertiaID-v0", num_envs=num_envs, stagger=True, autoreset_mode=autoreset_mode, **TASK
            )
        )
        self.autoreset_mode = self.env.unwrapped.autoreset_mode
        self._first: int | None = first_seed(seed, num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode in every environment."""
        seed, self._first = (seed, None) if self._first is None else (self._first, None)
        return self.env.reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        """Take one decision in every environment, with (N, 3) body rates, cut to [-1, 1]."""
        observations, rewards, terminations, truncations, infos = self.env.step(commanded(actions))
        return observations, rewards, terminations | truncations, np.zeros_like(truncations), infos


class SingleExcitation(gymnasium.Wrapper):
    """One satellite, for libraries that put single environments side by side: as in `Excitation`, but for `stagger`."""

    def step(self, action: Any) -> Any:
        """Take one decision, with 3 body rates, cut to [-1, 1]."""
        observation, reward, terminated, truncated, info = self.env.step(commanded(action))
        return observation, reward, terminated or truncated, False, info


gymnasium.register("Excitation-v0", lambda: SingleExcitation(gymnasium.make("SatInertiaID-v0", **TASK)))


def first_seed(seed: int, num_envs: int = ENVS) -> int:
    """Seed of the first environment of a training; the others have those that follow, and no two trainings share one.

    The environments of trainings 0 and 1 would be the same but for one with the seed of the training itself.
    """
    return seeds("training", num_envs, seed * num_envs)[0]


def updates(steps: int) -> int:
    """Number of rollouts in `steps` decisions."""
    return max(1, steps // (ENVS * ROLLOUT))


def commanded(actions: Any) -> np.ndarray:
    """The environment's actions (N, 3) for a policy's, which are cut to [-1, 1]."""
    return SHARE * np.clip(actions, -1.0, 1.0)


def network(env: Any, outputs: int, gain: float) -> torch.nn.Sequential:
    """Network of observations, with clocks of the last half minute.

    Args:
        env: whose observations.
        outputs: 3 of a policy, 1 of a value.
        gain: of the last layer's first weights: 0.01 of a policy, 1 of a value.
    """
    sizes = (env.single_observation_space.shape[0], *HIDDEN)
    layers: list[torch.nn.Module] = []
    for width, units in pairwise(sizes):
        layers += [orthogonal(torch.nn.Linear(width, units), 2.0**0.5), torch.nn.Tanh()]
    set_clocks(layers[0], env.unwrapped.problem)
    return torch.nn.Sequential(*layers, orthogonal(torch.nn.Linear(sizes[-1], outputs), gain))


def orthogonal(layer: torch.nn.Linear, gain: float) -> torch.nn.Linear:
    """A layer with orthogonal weights and no bias to begin with."""
    torch.nn.init.orthogonal_(layer.weight, gain)
    torch.nn.init.zeros_(layer.bias)
    return layer


class Learned:
    """Policy of the evaluation protocol around what a library has learned.

    Args:
        act: actions (N, 3) for observations (N, size), float32.
    """

    name, kind, include_covariance = "learned", "learned", True

    def __init__(self, act: Callable[[np.ndarray], np.ndarray]) -> None:
        self.act = act

    @classmethod
    def of(cls, actor: torch.nn.Module) -> Learned:
        """The policy whose actions are what a network gives for observations."""

        def act(observations: np.ndarray) -> np.ndarray:
            with torch.no_grad():
                return actor(torch.as_tensor(observations)).numpy()

        return cls(act)

    def reset(self, mission: Any, seeds: Any) -> None:
        """Nothing to prepare."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Actions (N, 3)."""
        return commanded(self.act(observation.astype(np.float32)))


def scores(policy: Learned, episodes: int = 64) -> dict[str, float]:
    """Mean final error and share of the time outside the envelope, on validation seeds and the benchmark's laws."""
    flight = fly(
        policy,
        satellite=TASK["satellite"],
        inertia="random",
        seeds=seeds("validation", episodes),
        scenario=benchmark_scenario(),
        control="rate",
    )
    return {name: float(flight.scores()[name].mean()) for name in ("final_error", "outside_fraction")}


def command(train: Callable[[int, int], Learned], name: str) -> None:
    """Command line of a trainer: learn, and print a row of the table."""
    parser = argparse.ArgumentParser(description=f"PPO by {name}: one row of the table in docs/trainers.md.")
    parser.add_argument("--steps", type=int, default=400_000, help="decisions, all environments together")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="of environments, networks and exploration")
    options = parser.parse_args()
    torch.set_num_threads(1)
    seconds, found = [], []
    for seed in options.seeds:
        start = time.perf_counter()
        policy = train(options.steps, seed)
        seconds.append(time.perf_counter() - start)
        found.append(scores(policy))
    errors = " ".join(f"{100 * score['final_error']:.4f}" for score in found)
    outside = " ".join(f"{100 * score['outside_fraction']:.2f}" for score in found)
    print(f"| {name} | {options.steps} | {errors} | {outside} | {np.mean(seconds):.0f} | {revision()} |")
