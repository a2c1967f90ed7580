"""Choose among runs that differ in their seed: `python -m agents.training.select RUN ... [--ship]`.

Flies every run's best policy through validation episodes, more of them than training could afford and with the
margin it would be shipped with; prints the scores, the spread over runs, and the best. `--ship` saves that one in
satid_gym/policies/learned/pretrained. Test seeds have no part in the choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from agents.training.run import SHOWN, condensed, merit, validate
from agents.training.settings import RESTART, Task
from agents.training.train import SETTINGS
from baselines.command import cli
from baselines.command.provenance import command
from satid_gym.config import check_integer, check_number
from satid_gym.files import read_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.shipped import PRETRAINED, RATE_PRETRAINED, find

_SAME = ("satellites", "inertia", "scenario", "actions", "judged_by")  # of runs to choose among


@dataclass(frozen=True, kw_only=True)
class SeedSelection:
    """Which runs."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of training runs."""
    ship: bool = False
    """Save the best policy with the shipped ones, one by the environment's rate loop in their folder rate."""
    margin: float | None = None
    """Margin of the rate loop to ship it with, where validation calls for another than that of training."""
    episodes: int = 400
    """Validation episodes on each satellite."""
    against: str | None = None
    """Learned policy, by name or path, whose errors in each cell the runs' are set against."""

    def policies(self) -> list[LearnedPolicy]:
        """The runs' best policies, each as it would be shipped.

        Raises:
            FileNotFoundError: a run has none.
            ValueError: there is no run, a policy is damaged, or a number is out of bounds.
        """
        if not self.runs:
            raise ValueError("name at least one run")
        check_integer("episodes", self.episodes)
        policies = [LearnedPolicy.load(run / "policy") for run in self.runs]
        for policy in policies:
            policy.margin = policy.margin if self.margin is None else check_number("margin", self.margin)
        return policies


def ratios(policies: Sequence[LearnedPolicy], against: LearnedPolicy, settings: Task, episodes: int) -> np.ndarray:
    """Final and mean error over those of another policy, time outside and cost, by policy and cell: (P, cells, 4).

    A cell is a satellite with one of the inertia modes; each has its share of the episodes.
    """
    modes = [settings.replace(inertia=mode) for mode in INERTIA_MODES]

    def flown(policy: LearnedPolicy) -> np.ndarray:
        rows = [row for mode in modes for row in validate(policy, mode, episodes // len(modes))]
        return np.array([[row[name] for name in SHOWN] for row in rows])

    reference = flown(against) * [1.0, 1.0, 0.0, 0.0] + [0.0, 0.0, 1.0, 1.0]
    return np.array([flown(policy) / reference for policy in tqdm(policies, unit=" runs", disable=None)])


def _training(policy: LearnedPolicy) -> Task:
    """The settings that a policy says it was trained with.

    Raises:
        ValueError: it says none, or what no training has.
    """
    try:
        trained = policy.details["trained"]
        return SETTINGS[trained["method"]].from_dict(trained["settings"])
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"policy {policy.name} does not say how it was trained ({error!r}): train it") from error


def check_same(runs: Sequence[Path], trained: Sequence[Task]) -> None:
    """Refuse runs whose scores are not of one world, or that are judged by different ones.

    Raises:
        ValueError: two differ in satellites, inertia, scenario, what actions are, or what judges them.
    """
    for run, own in zip(runs, trained, strict=True):
        others = [name for name in _SAME if getattr(own, name) != getattr(trained[0], name)]
        if others:
            raise ValueError(
                f"{run} was trained with other {', '.join(others)} than {runs[0]}: choose among runs of one setting"
            )


def _origin(run: Path) -> dict[str, Any]:
    """What a run's folder says of how it came to be; nothing where its policy says it itself.

    Raises:
        ValueError: the folder's notes are damaged.
    """
    notes, names = run / "run.json", ("command", "revision", "versions")
    if not notes.exists():
        return {}
    head = read_json(notes, RESTART, keys=names)
    return {name: head[name] for name in names}


def main(selection: SeedSelection) -> int:
    """Print the spread and the choice; the exit code."""
    with cli.user_errors():
        policies = selection.policies()
        other = None if selection.against is None else find(selection.against)
        trained = [_training(policy) for policy in policies]
        origins = [_origin(run) for run in selection.runs]
        check_same(selection.runs, trained)
    pairs = tqdm(list(zip(policies, trained, strict=True)), unit=" runs", disable=None)
    rows = [validate(policy, settings, selection.episodes) for policy, settings in pairs]
    shown_rows = [condensed(run) for run in rows]
    scores = np.array([[[row[name] for name in SHOWN] for row in run] for run in shown_rows])
    heads = "".join(f"{row['satellite']:>30s}" for row in shown_rows[0])
    print(f"{'':24s}{heads}   final, mean error, outside, cost in %")
    for run, score in zip(selection.runs, scores, strict=True):
        print(f"{run.name:24s}" + "".join("   " + " ".join(f"{100 * v:6.4f}" for v in cell) for cell in score))
    for name, statistic in (("mean", scores.mean(axis=0)), ("std", scores.std(axis=0, ddof=min(1, len(rows) - 1)))):
        print(f"{name:24s}" + "".join("   " + " ".join(f"{100 * v:6.4f}" for v in cell) for cell in statistic))
    if other is not None:
        found = ratios(policies, other, trained[0], selection.episodes)
        print(f"over {other.name}, mean and largest of {found.shape[1]} cells: final, mean error; outside, cost in %")
        for run, cells in zip(selection.runs, found, strict=True):
            shown = np.stack([cells.mean(axis=0), cells.max(axis=0)]) * [1.0, 1.0, 100.0, 100.0]
            print(f"{run.name:24s}" + "".join(f"   {mean:.3f} {most:.3f}" for mean, most in shown.T))
    best = int(np.argmin([merit(run, trained[0].judged_by) for run in rows]))
    measure = "reward" if trained[0].judged_by == "reward" else "final and mean error"
    print(f"best by {measure}: {selection.runs[best]}")
    if selection.ship:
        policy = policies[best]
        policy.details["trained"] = {**origins[best], **policy.details["trained"]}
        policy.details |= {"validation": rows[best], "validation_episodes": selection.episodes}
        policy.details["shipped_by"] = command("agents.training.select")
        path = (PRETRAINED if trained[best].actions == "torque" else RATE_PRETRAINED) / policy.name
        path.parent.mkdir(exist_ok=True)
        policy.save(path)
        print(f"shipped as {path}")
    return 0


if __name__ == "__main__":
    cli.run(main)
