"""Standing table: every policy in every scenario, on every satellite, under every inertia law, on test seeds.

All fly by body rates. Baselines have the settings that `python -m baselines.scenarios.tune` found for the satellite in
the scenario, on tuning seeds; learned policies fly as they are wherever their observation fits. What is compared is the
error that the filter expects, its mean over the flight, next to the error at the end, every cost and the NEES.

Each flight is kept in a file of its own: stopped, the same command goes on, and a second run flies only what is new.
Prints the ladder of each scenario and writes standing.json and the page standing.html.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm

from agents.standing.page import write_page
from agents.standing.replay import replay
from agents.standing.summary import Row, ladder, named, row, rung, show, show_named
from agents.standing.tasks import BOUND, ORACLE, Episodes, Task, misfit, tasks_of
from baselines.command import cli
from baselines.command.cluster import executor
from baselines.command.provenance import result_head
from baselines.scenarios.flights import Cell
from baselines.scenarios.rivals import rivals
from baselines.scenarios.tune import JUDGED
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.evaluation import FIRST_SEED, Split
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.custom import find_any
from satid_gym.policies.learned.shipped import names, rate_names
from satid_gym.policy import Policy
from satid_gym.satellite import BENCHMARK_SATELLITES

_SECONDS = {"reference": 1.0, "scripted": 1.0, "law": 1.0, "learned": 1.0, "planner": 20.0, ORACLE: 60.0, BOUND: 5.0}
"""First guess of the time of a task, for the estimate of what is left."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """What to fly."""

    scenarios: tuple[str, ...] = JUDGED
    """Scenarios to fly in."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    inertias: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["--modes"])] = INERTIA_MODES
    """Inertia modes to fly."""
    policies: tuple[str, ...] = ()
    """More policies to fly than those of the project: paths of a policy's files or of a run, module:name (runs the
    module's code), or NAME= before either of the two."""
    planners: bool = True
    """Fly the planners, which take most of the time."""
    episodes: int = 16
    """Episodes of each policy in each cell."""
    oracle: int = 0
    """Episodes of these that the oracle flies, where a scenario has one; it takes minutes a cell."""
    cost: float = 0.01
    """Largest cost of each kind, as a share of the time."""
    split: Annotated[Split, tyro.conf.arg(aliases=["--seed-split"])] = "test"
    """Seeds of the episodes."""
    again: bool = False
    """Fly what is kept too."""
    output: Path = Path("results/standing")
    """Folder for what is written, and where flights are kept."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or taken, or a number is out of range.
        """
        check_names("scenario", self.scenarios, JUDGED)
        check_names("satellite", self.satellites, BENCHMARK_SATELLITES)
        check_names("inertia mode", self.inertias, INERTIA_MODES)
        check_names("split of seeds", [self.split], FIRST_SEED)
        check_number("cost", self.cost, high=1.0)
        check_integer("episodes", self.episodes, low=2)
        check_integer("oracle", self.oracle, low=0, high=self.episodes)
        taken = {ORACLE, BOUND, *(name for scenario in self.scenarios for name in rivals(scenario))}
        for policy in self.others():
            if policy.name in taken:
                raise ValueError(f"the name {policy.name!r} is taken: give the policy another, NAME=PATH")
            taken.add(policy.name)

    def others(self) -> list[Policy]:
        """The shipped policies, and those that are named."""
        return [find_any(text) for text in (*names(), *rate_names(), *self.policies)]

    @property
    def cells(self) -> Iterator[Cell]:
        """All cells."""
        for scenario, satellite, inertia in itertools.product(self.scenarios, self.satellites, self.inertias):
            yield Cell(scenario=scenario, satellite=satellite, inertia=inertia)

    def tasks(self) -> list[Task]:
        """All that flies.

        Raises:
            ValueError: a rival is not tuned.
        """
        episodes = Episodes(split=self.split, count=self.episodes, oracle=self.oracle, cost=self.cost)
        others = self.others()
        found = [task for cell in self.cells for task in tasks_of(cell, episodes, others)]
        return [task for task in found if self.planners or _rung(task) != "planner"]

    def left_out(self) -> dict[str, dict[str, str]]:
        """Why policies that are no rivals do not fly in a scenario, by scenario and policy."""
        places = {s: Cell(scenario=s, satellite=self.satellites[0], inertia=self.inertias[0]) for s in self.scenarios}
        return {
            scenario: {policy.name: why for policy in self.others() if (why := misfit(policy, cell))}
            for scenario, cell in places.items()
        }


def _rung(task: Task) -> str:
    return rung({"policy": task.name, "kind": task.kind})


def fly(tasks: Sequence[Task], folder: Path, *, again: bool) -> list[dict[str, Any]]:
    """Results in the order of the tasks: those that are kept, and the others flown, as many at once as there are cores.

    The time that is left is estimated from what flights of the same policy in the same scenario have taken.
    """
    found = [None if again else task.kept(folder) for task in tasks]
    taken = {(t.cell.scenario, t.name): f["seconds"] for t, f in zip(tasks, found, strict=True) if f is not None}

    def guess(task: Task) -> float:
        return float(taken.get((task.cell.scenario, task.name), _SECONDS[_rung(task)]))

    todo = [i for i, result in enumerate(found) if result is None]
    looks = "{l_bar}{bar}| {elapsed}<{remaining} {postfix}"
    with executor(None) as pool, tqdm(total=sum(guess(tasks[i]) for i in todo), desc="flying", bar_format=looks) as bar:
        pending = {pool.submit(tasks[i].run, folder): (i, guess(tasks[i])) for i in todo}
        for left, done in enumerate(as_completed(pending), start=1 - len(todo)):
            place, expected = pending[done]
            found[place] = done.result()
            bar.set_postfix_str(
                f"{-left} flights left, {tasks[place].cell.scenario} {tasks[place].name}", refresh=False
            )
            bar.update(expected)
    return [result for result in found if result is not None]


@cli.on_interrupt("what was flown is kept; the same command goes on")
def main(table: Table) -> int:
    """Fly what the command line asks for, print and write; the exit code."""
    check_writable(table.output)
    with cli.user_errors():
        tasks = table.tasks()
    results = fly(tasks, table.output / "flights", again=table.again)
    rows: list[Row] = [row(task, found, table.cost) for task, found in zip(tasks, results, strict=True)]
    ladders = {name: ladder([r for r in rows if r["scenario"] == name]) for name in table.scenarios}
    seeds_flown = Episodes(split=table.split, count=table.episodes, oracle=0, cost=table.cost).seeds
    settings = {name: value for name, value in vars(table).items() if name != "again"}
    values = {
        **result_head("agents.standing", settings, split=table.split, seeds=seeds_flown),
        "left_out": table.left_out(),
        "ladders": ladders,
        "rows": rows,
    }
    write_json(table.output / "standing.json", values)
    cells = {name: next(cell for cell in table.cells if cell.scenario == name) for name in table.scenarios}
    episodes = {name: replay(cell, tasks, ladders[name], seeds_flown[0]) for name, cell in cells.items()}
    page = write_page(values, episodes, table.output)
    own = [find_any(text).name for text in table.policies]
    for name, steps in ladders.items():
        show(name, steps)
        show_named(named([r for r in rows if r["scenario"] == name], own, steps))
    revisions = sorted({r["revision"] for r in rows})
    if len(revisions) > 1:
        print(f"\nflights of several revisions ({', '.join(revisions)}): --again flies all of them again")
    print(f"\n{table.output / 'standing.json'} written\npage, for a browser: {page}")
    return 0
