"""Spread over seeds: runs of one training that differ in their seed, on test seeds in all cells of a scenario.

`python -m agents.standing.seeds RUN ... --scenario NAME`, for runs of `agents.train` and `agents.evolution` whose
policies command body rates. Prints a line for each run, and writes it with those of other trainings. What was flown is
kept in the folder flights next to the output: stopped, the same command goes on.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from agents.standing.summary import Row, mean_expected_error, row
from agents.standing.table import fly
from agents.standing.tasks import Episodes, misfit, policy_task
from baselines.command import cli
from baselines.command.markdown import table
from baselines.command.provenance import command, revision
from baselines.scenarios.flights import Cell
from baselines.scenarios.tune import JUDGED
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import FIRST_SEED, Split
from satid_gym.files import check_writable, read_json, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.custom import digest
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.shipped import find, rate_names
from satid_gym.satellite import BENCHMARK_SATELLITES

_REMEDY = "give another --output, or remove it and fly all trainings again"
_FREE = ("seed", "output", "ship", "workers", "validation")  # settings in which runs may differ
_LIMIT = 0.01  # largest cost of each kind, as a share of the time


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Which runs, and where they fly."""

    runs: tyro.conf.Positional[tuple[str, ...]]
    """Folders of runs that differ in their seed alone; or names of shipped policies."""
    scenario: str
    """Scenario to fly in."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    inertias: tuple[str, ...] = INERTIA_MODES
    """Inertia modes to fly."""
    episodes: int = 8
    """Episodes of each run in each cell."""
    split: Split = "test"
    """Seeds of the episodes; validation where runs are to be chosen among."""
    output: Path = Path("results/standing/seeds.json")
    """File that is written; what it has of other trainings stays."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown, a number is out of range, there is no run, or as of `policies`.
        """
        check_names("scenario", [self.scenario], JUDGED)
        check_names("satellite", self.satellites, BENCHMARK_SATELLITES)
        check_names("inertia mode", self.inertias, INERTIA_MODES)
        check_names("split of seeds", [self.split], FIRST_SEED)
        check_integer("episodes", self.episodes, low=2)
        if not self.runs:
            raise ValueError("name at least one run, such as runs/clear_tour-0")
        self.policies()

    @property
    def cells(self) -> list[Cell]:
        """Where the runs fly."""
        places = itertools.product(self.satellites, self.inertias)
        return [Cell(scenario=self.scenario, satellite=place, inertia=law) for place, law in places]

    def policies(self) -> list[LearnedPolicy]:
        """The runs' policies, each with the name of its run.

        Raises:
            ValueError: two have one name, or one is not there, does not say how it was trained, differs from the first
                in more than its seed, or cannot fly there.
        """
        if len(names := {Path(text).name for text in self.runs}) < len(self.runs):
            raise ValueError(
                f"runs must have different names, got {', '.join(sorted(names))} for {len(self.runs)} runs"
            )
        found = [find(text) for text in self.runs]
        first = _settings(found[0])
        for text, policy in zip(self.runs, found, strict=True):
            own = _settings(policy)
            if other := sorted(name for name in own.keys() | first.keys() if own.get(name) != first.get(name)):
                raise ValueError(
                    f"{text} was trained with other {', '.join(other)} than {self.runs[0]}: name runs that differ in "
                    "their seed alone"
                )
            if why := misfit(policy, self.cells[0]):
                raise ValueError(f"{text} does not fly in {self.scenario}: {why}")
            policy.name = Path(text).name
        return found


def _head(policy: LearnedPolicy) -> Mapping[str, Any]:
    """What a policy says of its training."""
    head = policy.details.get("trained", policy.details.get("training"))
    if not isinstance(head, Mapping) or "seed" not in head.get("settings", ()):
        raise ValueError(f"policy {policy.name} does not say how it was trained: train it again")
    return head


def _settings(policy: LearnedPolicy) -> dict[str, Any]:
    """Settings of its training that all runs have in common."""
    return {name: value for name, value in _head(policy)["settings"].items() if name not in _FREE}


def summary(policy: LearnedPolicy, rows: Sequence[Row]) -> dict[str, Any]:
    """Seed and time of training of a run, and its scores over the cells."""
    head, nees = _head(policy), [own["nees"] for own in rows]
    name = head["settings"]["name"]
    return {
        "seed": head["settings"]["seed"],
        "seconds": head.get("seconds"),
        "trained_at": head["revision"],
        "shipped": name in rate_names() and digest(find(name)) == digest(policy),
        "expected": mean_expected_error(rows),
        "cost": max(own["cost"] for own in rows),
        "inside": sum(own["inside"] for own in rows),
        "cells": len(rows),
        "nees": [min(nees), max(nees)],
    }


@cli.on_interrupt("what was flown is kept; the same command goes on")
def main(spread: Spread) -> int:
    """Fly the runs, print their spread and write it; the exit code."""
    check_writable(spread.output.parent)
    with cli.user_errors():
        policies = spread.policies()
        kept = read_json(spread.output, _REMEDY, keys=("trainings",))["trainings"] if spread.output.exists() else []
    episodes = Episodes(split=spread.split, count=spread.episodes, oracle=0, cost=_LIMIT)
    tasks = [policy_task(cell, episodes, {}, policy) for policy in policies for cell in spread.cells]
    results = fly(tasks, spread.output.parent / "flights", again=False)
    rows = [row(task, found, _LIMIT) for task, found in zip(tasks, results, strict=True)]
    training = {
        "policy": _head(policies[0])["settings"]["name"],
        "scenario": spread.scenario,
        "satellites": list(spread.satellites),
        "inertias": list(spread.inertias),
        "episodes": spread.episodes,
        "split": spread.split,
        "command": command("agents.standing.seeds"),
        "revision": revision(spread.output),
        "runs": [summary(policy, [own for own in rows if own["policy"] == policy.name]) for policy in policies],
    }
    place = training["policy"], training["scenario"]
    others = [own for own in kept if (own["policy"], own["scenario"]) != place]
    write_json(spread.output, {"trainings": sorted([*others, training], key=lambda own: str(own["policy"]))})
    print(seeds_table({"trainings": [training]}))
    print(f"{spread.output} written")
    return 0


def seeds_table(results: Mapping[str, Any]) -> str:
    """One line for each training: expected error of its seeds, their spread, and how long training takes."""
    lines, trainings = [], results["trainings"]
    for training in trainings:
        runs = sorted(training["runs"], key=lambda run: int(run["seed"]))
        errors = np.array([run["expected"] for run in runs if run["expected"] is not None])
        minutes = [run["seconds"] / 60.0 for run in runs if run["seconds"] is not None]
        lines.append(
            [
                f"`{training['policy']}`",
                f"`{training['scenario']}`",
                ", ".join(_error(run) for run in runs),
                f"{100.0 * errors.std(ddof=1) / errors.mean():.1f}" if len(errors) == len(runs) > 1 else "-",
                ", ".join(f"{100.0 * run['cost']:.2f}" for run in runs),
                f"{min(run['nees'][0] for run in runs):.2f} to {max(run['nees'][1] for run in runs):.2f}",
                f"{np.mean(minutes):.0f}" if minutes else "-",
            ]
        )
    head = ["policy", "scenario", "expected error by seed, %", "std, % of the mean", "largest cost by seed, %", "NEES"]
    flown = {
        f"{own['episodes']} {own['split']} episodes in each of {own['runs'][0]['cells']} cells" for own in trainings
    }
    revisions = sorted({own["revision"][:7] for own in trainings})
    return table([*head, "minutes of training"], lines, text_columns=3) + (
        f"\n\nExpected error: mean over the flight, geometric mean over cells; bold is what is shipped. "
        f"{'; '.join(sorted(flown))}. Revision {', '.join(revisions)}."
    )


def _error(run: Mapping[str, Any]) -> str:
    """Expected error of a run, in %."""
    shown = "ended early" if run["expected"] is None else f"{100.0 * run['expected']:.3g}"
    return f"**{shown}**" if run["shipped"] else shown


if __name__ == "__main__":
    cli.run(main)
