"""Compute time of a policy's decisions: `python -m baselines.timing` prints it for every baseline."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import tyro

from baselines.ending import ended
from baselines.registry import BASELINES, make_baseline
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policy import Kind, Mission, Policy


class TimedPolicy:
    """A policy, and how long its decisions took.

    Args:
        policy: what decides.

    Attributes:
        seconds: spent on decisions since the last reset.
        decisions: taken since then, one an episode and call.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy, self.name = policy, policy.name
        self.kind: Kind = policy.kind
        self.seconds, self.decisions = 0.0, 0

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the policy; the clock starts at zero."""
        self.policy.reset(mission, seeds)
        self.seconds, self.decisions = 0.0, 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The policy's action (N, n)."""
        start = time.perf_counter()
        action = self.policy(observation)
        self.seconds += time.perf_counter() - start
        self.decisions += len(observation)
        return action

    @property
    def decision_ms(self) -> float:
        """Mean time of a decision, ms; of a batch of N decisions each counts for a part in N."""
        return 1e3 * self.seconds / max(self.decisions, 1)


@dataclass(frozen=True, kw_only=True)
class Timing:
    """What to time."""

    satellite: str = "microsat"
    """Satellite to fly."""
    episodes: int = 100
    """Episodes side by side, beside one alone."""
    policies: tuple[str, ...] = tuple(BASELINES)
    """Baselines to time."""


def decision_ms(name: str, satellite: str, episodes: int) -> float:
    """Mean time of a baseline's decision in one flight of `episodes` side by side, ms."""
    policy = TimedPolicy(make_baseline(name, satellite))
    cell = {"satellite": satellite, "inertia": "random", "scenario": benchmark_scenario()}
    fly(policy, seeds=seeds("validation", episodes), **cell)  # type: ignore[arg-type]
    return policy.decision_ms


def main() -> None:
    """Command line."""
    timing = tyro.cli(Timing, description=__doc__)
    print(f"ms a decision, {timing.satellite}: alone | {timing.episodes} episodes side by side")
    for name in timing.policies:
        decision_ms(name, timing.satellite, 1)  # the first flight may compile
        times = [decision_ms(name, timing.satellite, count) for count in (1, timing.episodes)]
        print(f"{name:18s} {times[0]:8.4f} {times[1]:8.4f}")


if __name__ == "__main__":
    sys.exit(ended(main))
