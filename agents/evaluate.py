"""Score one learned policy: `python -m agents.evaluate POLICY`, a shipped name or the path of its files.

Validation seeds by default: the test seeds are for the comparison.
"""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from agents.compare import Comparison, compare
from agents.policies import find
from agents.tables import print_comparison
from baselines.ending import ended


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What to fly."""

    policy: tyro.conf.Positional[str]
    """A shipped policy's name, or a path without ending."""
    beside: tuple[str, ...] = ("rate_square",)
    """Baselines to fly beside it."""
    flights: Annotated[Comparison, tyro.conf.arg(name="")] = dataclasses.field(
        default_factory=lambda: Comparison(seed_split="validation")
    )


def main() -> int:
    """Fly the policy and print its tables; the exit code."""
    evaluation = tyro.cli(Evaluation, description=__doc__)
    try:
        policy = find(evaluation.policy)
        comparison = dataclasses.replace(evaluation.flights, policies=(policy.name, *evaluation.beside))
        comparison.check([policy])
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
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
