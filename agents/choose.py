"""Choose among runs that differ in their seed: `python -m agents.choose RUN ... [--ship]`.

Flies every run's best policy through validation episodes, more of them than training could afford and with the
margin it would be shipped with; prints the scores, the spread over runs, and the best. `--ship` saves that one in
agents/pretrained. Test seeds have no part in the choice.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from agents.learned import LearnedPolicy
from agents.policies import PRETRAINED
from agents.settings import TrainSettings
from agents.train import merit, validate
from baselines.ending import ended
from baselines.provenance import command
from satid_gym.config import check_number

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
    episodes: int = 400
    """Validation episodes on each satellite."""


def _scores(policy: LearnedPolicy, episodes: int) -> list[dict[str, Any]]:
    """Validation scores of a policy as it would be shipped, one row a satellite.

    Raises:
        KeyError: the policy does not say how it was trained.
        ValueError: what it says is no training's settings.
    """
    return validate(policy, TrainSettings.from_dict(policy.details["trained"]["settings"]), episodes)


def main() -> int:
    """Print the spread and the choice; the exit code."""
    options = tyro.cli(Options, description=__doc__)
    if options.episodes < 1:
        print(f"error: episodes must be at least 1, got {options.episodes}", file=sys.stderr)
        return 2
    try:
        policies = [LearnedPolicy.load(run / "policy") for run in options.runs]
        for policy in policies:
            policy.margin = policy.margin if options.margin is None else check_number("margin", options.margin)
    except (FileNotFoundError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    try:
        rows = [_scores(policy, options.episodes) for policy in tqdm(policies, unit=" runs", disable=None)]
    except (KeyError, TypeError, ValueError) as error:
        print(f"error: not all policies say how they were trained ({error!r}): train them", file=sys.stderr)
        return 2
    if any([row["satellite"] for row in run] != [row["satellite"] for row in rows[0]] for run in rows):
        print(
            "error: the runs were trained for different satellites: choose among runs of one setting", file=sys.stderr
        )
        return 2
    satellites = [row["satellite"] for row in rows[0]]
    scores = np.array([[[row[name] for name in _SHOWN] for row in run] for run in rows])
    print(f"{'':24s}" + "".join(f"{s:>24s}" for s in satellites) + "   final, mean error, outside in %")
    for run, score in zip(options.runs, scores, strict=True):
        print(f"{run.name:24s}" + "".join("   " + " ".join(f"{100 * v:6.4f}" for v in cell) for cell in score))
    for name, statistic in (("mean", scores.mean(axis=0)), ("std", scores.std(axis=0, ddof=min(1, len(rows) - 1)))):
        print(f"{name:24s}" + "".join("   " + " ".join(f"{100 * v:6.4f}" for v in cell) for cell in statistic))
    best = int(np.argmin([merit(run) for run in rows]))
    print(f"best by final and mean error: {options.runs[best]}")
    if options.ship:
        policy = policies[best]
        policy.details |= {"validation": rows[best], "validation_episodes": options.episodes}
        policy.details["shipped_by"] = command("agents.choose")
        policy.save(PRETRAINED / policy.name)
        print(f"shipped as {PRETRAINED / policy.name}")
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
