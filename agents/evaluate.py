"""Score one learned policy: `python -m agents.evaluate POLICY`, a shipped name or the path of its files.

Validation seeds by default: the test seeds are for the comparison.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import tyro

from agents.compare import Comparison, compare
from agents.tables import print_comparison
from baselines.ending import ended, refusal
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.shipped import find
from satid_gym.satellite import SATELLITES


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What to fly."""

    policy: tyro.conf.Positional[str]
    """A shipped policy's name, or a path without ending."""
    beside: tuple[str, ...] = ("rate_square",)
    """Baselines to fly beside it."""
    scenario: str = "default"
    """The world: default, tight, paper or faults."""
    satellites: tuple[str, ...] = tuple(SATELLITES)
    """Satellites to fly."""
    modes: tuple[str, ...] = INERTIA_MODES
    """How their inertia varies."""
    episodes: int = 100
    """Episodes of each policy in each cell."""
    seed_split: str = "validation"
    """Which seeds: training, tuning, validation or test."""

    def comparison(self, policy: str) -> Comparison:
        """The flights of a policy of this name and those beside it."""
        return Comparison(
            scenario=self.scenario,
            satellites=self.satellites,
            modes=self.modes,
            policies=(policy, *self.beside),
            episodes=self.episodes,
            seed_split=self.seed_split,
        )


def main() -> int:
    """Fly the policy and print its tables; the exit code."""
    evaluation = tyro.cli(Evaluation, description=__doc__)
    with refusal():
        policy = find(evaluation.policy)
        comparison = evaluation.comparison(policy.name)
        comparison.check([policy])
    results = compare(comparison, [policy])
    split, first = results["seeds"]["split"], results["seeds"]["first"]
    print_comparison(
        results["records"],
        f"{evaluation.policy}: {comparison.episodes} episodes a cell, {split} seeds from {first}, "
        f"scenario {comparison.scenario}",
    )
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
