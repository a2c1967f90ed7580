"""Training run, the same for every algorithm: its folder, learning curve, validation and policies."""

from __future__ import annotations

import csv
import io
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from agents.training.settings import Task
from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.files import PART, write_json, write_text
from satid_gym.metrics import BEYOND_MAX
from satid_gym.policies.learned import LearnedPolicy

SCORES = ("reward", "final_error", "mean_error", "outside_fraction", "saturated_fraction", "nees", "cost")
SHOWN = ("final_error", "mean_error", "outside_fraction", "cost")  # of them, by commands
_EACH_INSIDE_MAX = 6  # satellites of which each is to stay within its limits
_BEYOND_SHARE_MAX = 0.05  # of more satellites
_ROWS_SHOWN = 6  # scores of more satellites are shown as their mean


def validate(policy: LearnedPolicy, settings: Task, episodes: int) -> list[dict[str, Any]]:
    """Mean scores on validation seeds and the paper's laws, one row a satellite."""
    rows = []
    for satellite in settings.satellites:
        flight = fly(
            policy,
            satellite=satellite,
            inertia=settings.inertia,
            seeds=seeds("validation", episodes),
            scenario=benchmark_scenario(settings.scenario),
            control=settings.actions,
        )
        scores = {name: float(np.mean(value)) for name, value in flight.scores().items()}
        rows.append({"satellite": satellite.name, **{name: scores[name] for name in SCORES}})
    return rows


def merit(rows: list[dict[str, Any]], judged_by: str = "errors") -> float:
    """Figure of merit, lower is better: geometric mean of final and mean errors, times the excess of the cost over 1 %.

    The cost is the mean over the decisions of the largest of each, `info["cost"]`, so it counts every limit that the
    scenario has: rates, wheels, panels, tanks and payload. Of more than six satellites, one in twenty may be beyond.
    Judged by "reward": minus the mean reward.
    """
    if judged_by == "reward":
        return -float(np.mean([row["reward"] for row in rows]))
    errors = [row[name] for row in rows for name in ("final_error", "mean_error")]
    costs = np.array([row["cost"] for row in rows])
    excess = costs.max() / BEYOND_MAX
    if len(rows) > _EACH_INSIDE_MAX:
        excess = np.mean(costs > BEYOND_MAX) / _BEYOND_SHARE_MAX
    return float(np.exp(np.mean(np.log(errors)))) * max(1.0, float(excess))


def condensed(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Validation scores with one row in place of many: of the errors the geometric mean, of all else the mean."""
    if len(rows) <= _ROWS_SHOWN:
        return rows
    means = {name: float(np.mean([row[name] for row in rows])) for name in SCORES}
    errors = {
        name: float(np.exp(np.mean([np.log(row[name]) for row in rows]))) for name in ("final_error", "mean_error")
    }
    return [{"satellite": f"{len(rows)} satellites", **means, **errors}]


def summary(rows: list[dict[str, Any]]) -> str:
    """Validation scores in a line."""
    text = "  ".join(" ".join([r["satellite"], *(f"{100 * r[name]:.3f}" for name in SHOWN)]) for r in condensed(rows))
    return f"final, mean error, outside and cost in %:  {text}"


class Run:
    """A training run and its folder.

    The folder has run.json (command, revision, versions, algorithm, settings), curve.csv (scores on validation seeds),
    the policies `policy` and `last`, and what the algorithm needs to go on after a stop.

    Args:
        settings: of the run.
        folder: of the run.
        resume: whether to go on with the run in it.
        module: of the command that starts it.

    Attributes:
        curve: rows of curve.csv.
        best: merit of `policy`, the lowest so far.
        bar: the progress bar; an algorithm makes it by `progress`.

    Raises:
        ValueError: the folder holds a run and `resume` is False, or holds none and `resume` is True.
        OSError: the folder cannot be written.
    """

    bar: tqdm

    def __init__(self, settings: Task, folder: Path, *, resume: bool, module: str) -> None:
        self.settings, self.folder = settings, folder
        started = (folder / "run.json").exists()
        if started and not resume:
            raise ValueError(f"{folder} holds a run already: add --resume to go on with it, or choose another --run")
        if resume and not started:
            raise ValueError(f"{folder} holds no run to resume")
        self.curve: list[dict[str, Any]] = []
        self.best = np.inf
        self.again = f"go on with: {shlex.join(['python', '-m', module, '--run', str(folder), '--resume'])}"
        folder.mkdir(parents=True, exist_ok=True)
        if not resume:
            head = {**result_head(module, settings.to_dict()), "algorithm": settings.algorithm}
            write_json(folder / "run.json", head)
        for part in folder.glob(f".*{PART}"):  # what was being written when the process was killed
            part.unlink()
        torch.set_num_threads(1)  # numba's threads and torch's would fight for the cores

    def progress(self, total: int, done: int, unit: str) -> tqdm:
        """The progress bar, to be used with `with`."""
        self.bar = tqdm(total=total, initial=done, unit=f" {unit}", unit_scale=total > 10_000)
        return self.bar

    def evaluate(self, policy: LearnedPolicy, **at: Any) -> list[dict[str, Any]]:
        """Score a policy on validation seeds: new rows of the curve, also kept in the policy's details.

        Args:
            policy: to fly.
            **at: how far training is, by the names of the curve's first columns.
        """
        s = self.settings
        rows = validate(policy, s, s.evaluation_episodes)
        self.curve += [{**at, **row} for row in rows]
        trained = {"method": s.algorithm, "settings": s.to_dict(), "seed": s.seed, **at}
        policy.details = {"trained": trained, "validation": rows}
        self.bar.write(f"{' '.join(str(v) for k, v in at.items() if k != 'seconds'):>9s}  {summary(rows)}")
        return rows

    def keep(self, policy: LearnedPolicy) -> None:
        """Save an evaluated policy as `last`, and as `policy` if none was better."""
        policy.save(self.folder / "last")
        score = merit(policy.details["validation"], self.settings.judged_by)
        if score < self.best:
            self.best = score
            policy.save(self.folder / "policy")

    def write_curve(self) -> None:
        """Write curve.csv; rows of a run that an earlier version began have no cost."""
        table = io.StringIO()
        writer = csv.DictWriter(table, list(self.curve[-1]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.curve)
        write_text(self.folder / "curve.csv", table.getvalue())


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Where a run goes."""

    run: Path | None = None
    """Folder of the run; runs/NAME-SEED by default."""
    resume: bool = False
    """Go on with the run in that folder, by the settings it was started with."""

    def start(self, train: Callable[[Run], Any], settings: Task, module: str) -> int:
        """Run an algorithm to its end; the exit code.

        Args:
            train: the algorithm.
            settings: of the run; those in its folder if it is resumed.
            module: of the command.
        """
        folder = self.run or Path("runs") / f"{settings.name}-{settings.seed}"
        with cli.user_errors():
            run = Run(settings, folder, resume=self.resume, module=module)
        with cli.on_interrupt(run.again):
            train(run)
        return 0
