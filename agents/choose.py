"""Choose among runs that differ in their seed: `python -m agents.choose RUN ... [--ship]`.

Prints every run's best policy on the validation seeds, the spread over runs, and the best; `--ship` saves that one
in agents/pretrained. Test seeds have no part in the choice.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from agents.learned import LearnedPolicy
from agents.policies import PRETRAINED
from agents.train import merit
from baselines.ending import ended
from baselines.provenance import command

_SHOWN = ("final_error", "mean_error", "outside_fraction")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Which runs."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of training runs."""
    ship: bool = False
    """Save the best policy in agents/pretrained."""
    margin: float | None = None
    """Margin of the rate loop to ship it with, where validation calls for another than that of training."""


def main() -> int:
    """Print the spread and the choice; the exit code."""
    options = tyro.cli(Options, description=__doc__)
    try:
        policies = [LearnedPolicy.load(run / "policy") for run in options.runs]
    except (FileNotFoundError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    try:
        rows = [policy.details["validation"] for policy in policies]
        scores = np.array([[[row[name] for name in _SHOWN] for row in run] for run in rows])
        satellites = [row["satellite"] for row in rows[0]]
    except (KeyError, TypeError, ValueError) as error:
        print(f"error: not all policies hold scores of the same validation ({error!r}): train them", file=sys.stderr)
        return 2
    print(f"{'':24s}" + "".join(f"{s:>24s}" for s in satellites) + "   final, mean error, outside in %")
    for run, score in zip(options.runs, scores, strict=True):
        print(f"{run.name:24s}" + "".join("   " + " ".join(f"{100 * v:6.4f}" for v in cell) for cell in score))
    for name, statistic in (("mean", scores.mean(axis=0)), ("std", scores.std(axis=0, ddof=min(1, len(rows) - 1)))):
        print(f"{name:24s}" + "".join("   " + " ".join(f"{100 * v:6.4f}" for v in cell) for cell in statistic))
    best = int(np.argmin([merit(run) for run in rows]))
    print(f"best by final and mean error: {options.runs[best]}")
    if options.ship:
        policy = policies[best]
        if options.margin is not None:
            policy.margin = options.margin
        policy.details["shipped_by"] = command("agents.choose")
        policy.save(PRETRAINED / policy.name)
        print(f"shipped as {PRETRAINED / policy.name}")
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
