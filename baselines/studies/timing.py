"""Compute time per decision of every baseline and shipped policy: `python -m baselines.timing`.

Measured for one episode and for many episodes in parallel.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baselines.command.provenance import result_head
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.policies.learned.shipped import find, names
from satid_gym.policies.registry import BASELINES, make_baseline
from satid_gym.policy import FilterPlanner, Kind, Mission, Policy, observation_settings
from satid_gym.satellite import SATELLITES


class TimedPolicy:
    """Policy with the compute time of its decisions.

    Args:
        policy: the policy to time.

    Attributes:
        times: of each call since the last reset, divided by its number of episodes, s.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy, self.name = policy, policy.name
        self.kind: Kind = policy.kind
        vars(self).update(observation_settings(policy))  # it observes what that policy asks for
        if isinstance(policy, FilterPlanner):
            self.see = policy.see
        self.times: list[float] = []

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the policy and clear the times."""
        self.policy.reset(mission, seeds)
        self.times = []

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The policy's action (N, n)."""
        start = time.perf_counter()
        action = self.policy(observation)
        self.times.append((time.perf_counter() - start) / len(observation))
        return action

    @property
    def decision_ms(self) -> float:
        """Median time of a decision, ms; not affected by compilation in the first call; 0 before the first."""
        return 1e3 * float(np.median(self.times)) if self.times else 0.0


@dataclass(frozen=True, kw_only=True)
class TimingStudy:
    """Settings of the measurement."""

    satellite: str = "microsat"
    """Satellite to fly."""
    episodes: int = 100
    """Episodes in parallel; one alone is timed as well."""
    policies: tuple[str, ...] = (*BASELINES, *names())
    """Baselines and shipped policies to time."""
    output: Path | None = None
    """File for the results, .json; if not given, they are only printed."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or the number of episodes is not positive.
        """
        check_names("satellite", (self.satellite,), SATELLITES)
        check_names("policy", self.policies, [*BASELINES, *names()])
        check_integer("episodes", self.episodes)


def decision_ms(name: str, satellite: str, episodes: int) -> float:
    """Median time per decision of a baseline or shipped policy, ms, for `episodes` in parallel."""
    policy = TimedPolicy(make_baseline(name, satellite) if name in BASELINES else find(name))
    cell = {"satellite": satellite, "inertia": "random", "scenario": benchmark_scenario()}
    fly(policy, seeds=seeds("validation", episodes), **cell)  # type: ignore[arg-type]
    return policy.decision_ms


def main(timing: TimingStudy) -> int:
    """Measure the policies of the command line; returns the exit code."""
    if timing.output is not None:
        check_writable(timing.output.parent)
    found = {}
    print(f"ms a decision, {timing.satellite}: alone | {timing.episodes} episodes side by side")
    for name in timing.policies:
        decision_ms(name, timing.satellite, 1)  # the first flight may compile
        alone, together = (decision_ms(name, timing.satellite, count) for count in (1, timing.episodes))
        print(f"{name:18s} {alone:8.4f} {together:8.4f}")
        found[name] = {"alone": alone, "side_by_side": together}
    if timing.output is not None:
        cell = {"satellite": timing.satellite, "episodes": timing.episodes}
        write_json(timing.output, {**result_head("baselines.timing"), **cell, "decision_ms": found})
    return 0
