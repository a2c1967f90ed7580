"""Task of the trainers in this folder: environments to train in, and scores of what was learned.

Actions are body rates of the microsat as fractions of what may be commanded, observations hold the filter's whole
covariance, and the reward is small where the inertia is well known. Each trainer is one file with a command line.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

import satid_gym  # noqa: F401  # registers SatInertiaID-v0
from baselines.command.provenance import revision
from satid_gym.evaluation import benchmark_scenario, fly, seeds

SHARE = 0.97  # of the rate limit may be commanded: the rate has noise about what is commanded
SATELLITE = "microsat"
DECISIONS = 300  # of an episode
ENVS, ROLLOUT, EPOCHS, MINIBATCHES = 64, 50, 5, 4  # of PPO, in whatever library
GAMMA, GAE_LAMBDA, CLIP, LEARNING_RATE, LOG_STD = 0.9, 0.8, 0.2, 2e-3, 0.0
HIDDEN = (64, 64)  # units of the layers, tanh after each, of policy and value


class Excitation(VectorWrapper):
    """The satellite, many times, with the first reset of a given seed: libraries seed differently or not at all.

    The first episodes have less time left, evenly spread (`stagger`), so that a rollout holds every part of an episode.

    Args:
        autoreset_mode: what the library expects of the environments.
        seed: of the first reset; later ones go on from it.
        num_envs: how many.
    """

    def __init__(self, autoreset_mode: AutoresetMode, seed: int, num_envs: int = ENVS) -> None:
        envs = gymnasium.make_vec(
            "SatInertiaID-v0",
            num_envs=num_envs,
            satellite=SATELLITE,
            control="rate",
            include_covariance=True,
            reward={"held_reference": 22.0},
            stagger=True,
            autoreset_mode=autoreset_mode,
        )
        super().__init__(envs)
        self.autoreset_mode = autoreset_mode
        self._first: int | None = seed

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode in every environment."""
        seed, self._first = (seed, None) if self._first is None else (self._first, None)
        return self.env.reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        """Take one decision in every environment, with (N, 3) body rates, cut to [-1, 1]."""
        return self.env.step(SHARE * np.clip(actions, -1.0, 1.0))


class Learned:
    """Policy of the evaluation protocol around what a library has learned.

    Args:
        act: actions (N, 3) for observations (N, size), float32.
    """

    name, kind, include_covariance = "learned", "learned", True

    def __init__(self, act: Callable[[np.ndarray], np.ndarray]) -> None:
        self.act = act

    def reset(self, mission: Any, seeds: Any) -> None:
        """Nothing to prepare."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Actions (N, 3)."""
        return SHARE * np.clip(self.act(observation.astype(np.float32)), -1.0, 1.0)


def scores(act: Callable[[np.ndarray], np.ndarray], episodes: int = 64) -> dict[str, float]:
    """Mean final error and share of the time outside the envelope, on validation seeds and the benchmark's laws."""
    flight = fly(
        Learned(act),
        satellite=SATELLITE,
        inertia="random",
        seeds=seeds("validation", episodes),
        scenario=benchmark_scenario(),
        control="rate",
    )
    return {name: float(flight.scores()[name].mean()) for name in ("final_error", "outside_fraction")}


def command(train: Callable[[int, int], Callable[[np.ndarray], np.ndarray]], name: str) -> None:
    """Command line of a trainer: learn, and print a row of the table."""
    parser = argparse.ArgumentParser(description=f"PPO by {name}: one row of the table in docs/trainers.md.")
    parser.add_argument("--steps", type=int, default=400_000, help="decisions, all environments together")
    parser.add_argument("--seed", type=int, default=0, help="of environments, network and exploration")
    options = parser.parse_args()
    start = time.perf_counter()
    act = train(options.steps, options.seed)
    seconds = time.perf_counter() - start
    found = scores(act)
    print("| trainer | decisions | seed | final error, % | outside, % | s | revision |")
    print(
        f"| {name} | {options.steps} | {options.seed} | {100 * found['final_error']:.4f} | "
        f"{100 * found['outside_fraction']:.2f} | {seconds:.0f} | {revision()} |"
    )
