"""Compute time of a policy's decisions: `python -m baselines.timing` prints it.

Of every baseline and shipped policy, alone and with many episodes side by side.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from baselines.ending import ended, refusal
from baselines.provenance import command, revision, versions
from satid_gym.config import check_names, check_whole
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.policies.registry import BASELINES, make_baseline
from satid_gym.policies.shipped import find, names
from satid_gym.policy import Kind, Mission, Policy, includes_covariance
from satid_gym.satellite import SATELLITES


class TimedPolicy:
    """A policy, and how long its decisions took.

    Args:
        policy: what decides.

    Attributes:
        times: s, of each call since the last reset, by the episodes that it decided for.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy, self.name = policy, policy.name
        self.kind: Kind = policy.kind
        self.include_covariance = includes_covariance(policy)
        self.times: list[float] = []

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the policy; times are counted anew."""
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
        """Median time of a decision, ms, which a first call that compiles does not move; 0 before the first."""
        return 1e3 * float(np.median(self.times)) if self.times else 0.0


@dataclass(frozen=True, kw_only=True)
class Timing:
    """What to time."""

    satellite: str = "microsat"
    """Satellite to fly."""
    episodes: int = 100
    """Episodes side by side, beside one alone."""
    policies: tuple[str, ...] = (*BASELINES, *names())
    """Baselines and shipped policies to time."""
    output: Path | None = None
    """File for the figures, .json; they are printed only where none is given."""

    def check(self) -> None:
        """Refuse what cannot be timed.

        Raises:
            ValueError: a name is unknown or there is no episode.
        """
        check_names("satellite", (self.satellite,), SATELLITES)
        check_names("policy", self.policies, [*BASELINES, *names()])
        check_whole("episodes", self.episodes)


def decision_ms(name: str, satellite: str, episodes: int) -> float:
    """Median time of a decision of a baseline or shipped policy, `episodes` flying side by side, ms."""
    policy = TimedPolicy(make_baseline(name, satellite) if name in BASELINES else find(name))
    cell = {"satellite": satellite, "inertia": "random", "scenario": benchmark_scenario()}
    fly(policy, seeds=seeds("validation", episodes), **cell)  # type: ignore[arg-type]
    return policy.decision_ms


def main() -> int:
    """Time what the command line asks for; the exit code."""
    timing = tyro.cli(Timing, description=__doc__)
    with refusal():
        timing.check()
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
        made = {"command": command("baselines.timing"), "revision": revision(), "versions": versions()}
        cell = {"satellite": timing.satellite, "episodes": timing.episodes}
        write_json(timing.output, {**made, **cell, "decision_ms": found})
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
