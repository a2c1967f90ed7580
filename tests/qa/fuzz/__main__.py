"""Fly thousands of random configurations, valid and spoiled, and print what was found.

    python -m tests.qa.fuzz --configurations 10000 --seed 0
    python -m tests.qa.fuzz --only 1234 --seed 0        one of them again, in full

Configuration i of a seed is always the same, so `--only` reproduces a failure and `--first` goes on after a stop.
"""

from __future__ import annotations

import collections
import json
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym import SatInertiaIDEnv
from satid_gym.config import check_integer, check_names
from satid_gym.estimators import ESTIMATORS
from satid_gym.files import check_writable, write_json
from tests.qa.fuzz.configuration import SHEETS, Configuration, Group, draw_configuration
from tests.qa.fuzz.flight import Breakdown, Undrawable, Violation, fly
from tests.qa.fuzz.spoil import refused, refuses_actions, spoil


@dataclass(frozen=True, kw_only=True)
class Fuzz:
    """What to fuzz."""

    configurations: int = 10_000
    """How many configurations; each is flown as it is and refused once spoiled."""
    seed: int = 0
    """Of the configurations."""
    first: int = 0
    """Configuration to begin with."""
    only: int | None = None
    """Fly this one alone and print it."""
    decisions: int = 300
    """Decisions that each flies."""
    wheels: tuple[int, ...] = (3, 4, 5, 6, 7, 8)
    """Numbers of wheels; each compiles four kernels, up to a minute each, on the first run."""
    estimators: tuple[str, ...] = ("momentum", "rate")
    """Filters; "adaptive" as well is flown by the kernels of "momentum"."""
    sheets: tuple[str, ...] = SHEETS
    """What data sheets have beyond nominal values; the filter "rate" is flown with the first two alone."""
    output: Path = Path("results/fuzz.json")
    """Where the findings go."""

    def check(self) -> None:
        """Refuse what cannot be flown.

        Raises:
            ValueError: a number is out of range.
        """
        check_integer("configurations", self.configurations)
        check_integer("decisions", self.decisions)
        check_integer("first", self.first, low=0, high=self.configurations - 1)
        if self.only is not None:
            check_integer("only", self.only, low=0, high=self.configurations - 1)
        if not self.wheels:
            raise ValueError("name at least one number of wheels")
        check_names("estimator", self.estimators, ESTIMATORS)
        check_names("sheet", self.sheets, SHEETS)
        for wheels in self.wheels:
            check_integer("wheels", wheels, low=3)

    def groups(self) -> list[Group]:
        """Groups in the order flown: the fewest wheels first."""
        return [
            Group(wheels=n, parameters=parameters, estimator=estimator, sheet=sheet)
            for n in self.wheels
            for parameters in ("principal", "full")
            for estimator in self.estimators
            for sheet in self.sheets
            if estimator != "rate" or sheet in SHEETS[:2]
        ]

    def group(self, index: int) -> Group:
        """Group of a configuration; those of a group come one after the other."""
        groups = self.groups()
        return groups[index * len(groups) // self.configurations]

    def draw(self, index: int) -> tuple[Configuration, Random]:
        """Configuration `index`, and the chance to go on with."""
        chance = Random(f"{self.seed}/{index}")
        return draw_configuration(chance, self.group(index)), chance


@dataclass
class Findings:
    """What was found in one group."""

    flown: int = 0
    refused: int = 0
    undrawable: int = 0
    breakdown: list[int] = field(default_factory=list)
    tally: collections.Counter[str] = field(default_factory=collections.Counter)
    drift: float = 0.0
    failures: list[dict[str, Any]] = field(default_factory=list)


def examine(fuzz: Fuzz, index: int, findings: Findings) -> None:
    """Fly one configuration and have its spoiled form refused; note what happened."""
    configuration, chance = fuzz.draw(index)
    settings, wrong = spoil(chance, configuration)
    try:
        refused(settings)
        findings.refused += 1
    except Violation as violation:
        findings.failures.append({"index": index, "what": f"{wrong}: {violation}"})
    try:
        tally = fly(configuration, fuzz.decisions)
        env = SatInertiaIDEnv(**configuration.settings)
        env.reset(seed=configuration.seed, options=configuration.options)
        refuses_actions(env, chance)
    except Undrawable:
        findings.undrawable += 1
    except Breakdown:
        findings.breakdown.append(index)
    except Exception as error:  # whatever it is, it is a finding, and the others are to be flown as well
        findings.failures.append({"index": index, "what": f"{type(error).__name__}: {error}"})
    else:
        findings.flown += 1
        findings.drift = max(findings.drift, tally.pop("drift"))
        findings.tally.update(tally)


def run(fuzz: Fuzz) -> dict[Group, Findings]:
    """Examine every configuration; what was found so far where it is interrupted."""
    found = {group: Findings() for group in fuzz.groups()}
    indices = range(fuzz.first, fuzz.configurations) if fuzz.only is None else range(fuzz.only, fuzz.only + 1)
    try:
        with tqdm(indices, desc="fuzzing", unit="configuration") as bar:
            for index in bar:
                group = fuzz.group(index)
                bar.set_postfix_str(str(group), refresh=False)
                before = len(found[group].failures)
                examine(fuzz, index, found[group])
                for failure in found[group].failures[before:]:
                    bar.write(f"{failure['index']}: {failure['what']}"[:300])
    except KeyboardInterrupt:
        print(f"stopped; go on with --first {index}", file=sys.stderr)
    return found


def print_findings(found: dict[Group, Findings]) -> None:
    """One row a group."""
    table = Table(title="Fuzz")
    table.add_column("group", no_wrap=True)
    for heading in ("flown", "refused", "no draw", "breakdown", "episodes", "|M| drift", "failures"):
        table.add_column(heading, justify="right")
    for group, f in found.items():
        episodes = f.tally["terminated"] + f.tally["truncated"]
        cells = (f.flown, f.refused, f.undrawable, len(f.breakdown), episodes, f"{f.drift:.0e}", len(f.failures))
        table.add_row(str(group), *map(str, cells))
    Console(width=120).print(table)


def main(fuzz: Fuzz) -> int:
    """The exit code: 1 where something failed."""
    check_writable(fuzz.output.parent)
    start = time.perf_counter()
    if fuzz.only is not None:
        configuration, _ = fuzz.draw(fuzz.only)
        print(json.dumps(configuration.__dict__, default=lambda x: x.tolist() if isinstance(x, np.ndarray) else x))
    found = run(fuzz)
    print_findings(found)
    failures = [{"group": str(group), **failure} for group, f in found.items() for failure in f.failures]
    for failure in failures:
        print(
            f"{failure['group']}: python -m tests.qa.fuzz --seed {fuzz.seed} --configurations {fuzz.configurations} "
            f"--only {failure['index']}: {failure['what'][:200]}"
        )
    totals = {name: sum(getattr(f, name) for f in found.values()) for name in ("flown", "refused", "undrawable")}
    write_json(
        fuzz.output,
        {
            **result_head("tests.qa.fuzz"),
            **totals,
            "breakdowns": {str(group): f.breakdown for group, f in found.items()},
            "failures": failures,
            "seconds": round(time.perf_counter() - start, 1),
        },
    )
    print(f"{totals}, {len(failures)} failures; {fuzz.output} written; {time.perf_counter() - start:.0f} s")
    return 1 if failures else 0


if __name__ == "__main__":
    cli.run(main)
