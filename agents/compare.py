"""The benchmark: every policy on 3 satellites x 4 inertia modes, on the same held-out episodes.

Prints tables and writes compare.json, compare.csv and the page report.html. All policies of a cell fly the same
truth and the same noise; the inertia follows the paper's laws; the test seeds were used by neither tuning nor
training.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import os
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from agents.cast import Cast, Prepared, learned_by, misfit
from agents.cell import Cell
from agents.report import write_report
from agents.report.curves import error_bands, rounded
from agents.report.episode import episode_cell, fly_episode, protagonists
from agents.report.page import file_names
from agents.statistics import pair, record
from agents.tables import print_comparison
from baselines import BASELINES
from baselines.ending import ended, refusal
from baselines.provenance import command, portable, revision, versions
from satid_gym.config import check_names
from satid_gym.evaluation import FIRST_SEED, benchmark_scenario, seeds
from satid_gym.files import check_writable, write_json, write_text
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.open_loop_optimal import NotPreparedError
from satid_gym.policies.shipped import names
from satid_gym.policy import Policy
from satid_gym.satellite import SATELLITES
from satid_gym.selection import label, select_inertias, select_satellites, select_scenario

CHALLENGERS = ("learned", "closed_loop")  # kinds that are set against every other policy, in pairs
Scores = Mapping[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What to compare."""

    scenario: str = "default"
    """The world: default, tight, paper or faults, a .json or .toml file, or module:name (runs the module's code)."""
    satellites: tuple[str, ...] = tuple(SATELLITES)
    """Satellites to fly: names, .json or .toml files, or module:name (runs the module's code)."""
    modes: tuple[str, ...] = INERTIA_MODES
    """How their inertia varies: modes, laws as .json, .toml or .csv files, or module:name (runs the module's code)."""
    policies: tuple[str, ...] = ()
    """Policies to compare: names, paths of a policy's files or of a run's folder, or NAME=PATH; where none is named
    all that come with the project."""
    prepared: Annotated[Prepared, tyro.conf.arg(name="")] = field(default_factory=Prepared)
    episodes: int = 100
    """Episodes of each policy in each cell."""
    seed_split: str = "test"
    """Which seeds: training, tuning, validation or test."""
    output: Path = Path("results")
    """Folder for what is written; scenarios other than default add their name to the files'."""

    def cast(self) -> Cast:
        """What names, files and modules stand for.

        Raises:
            ValueError: a name is unknown or taken by another, what a file holds is not valid, a baseline that was
                named has no settings for a satellite, or the number of episodes is below 2.
            DamagedFileError: a file of settings of baselines is missing or holds none.
        """
        scenario = select_scenario(self.scenario)
        satellites = select_satellites(self.satellites)
        modes = select_inertias(self.modes)
        learned, given = learned_by(self.policies or names())
        check_names("split of seeds", (self.seed_split,), FIRST_SEED)
        if self.episodes < 2:
            raise ValueError(f"episodes must be at least 2 for an interval, got {self.episodes}")
        texts = list(zip(self.satellites, satellites, strict=True))
        world = (self.scenario, scenario)
        self.prepared.check(texts, [world])
        teams: dict[str, list[Policy]] = {}
        not_tuned: list[str] = []
        for satellite in satellites:
            teams[satellite.name] = team = []
            for name in (name for name in BASELINES if name in (self.policies or BASELINES)):
                policy, line = self.prepared.find(name, satellite, world, texts)
                if policy is not None:
                    team.append(policy)
                elif self.policies:
                    raise NotPreparedError(line)
                if line:
                    not_tuned.append(line)
            for policy in learned:
                line = misfit(policy, satellite, modes, scenario)
                if not line:
                    team.append(policy)
                elif self.policies:
                    raise ValueError(line)
                else:
                    not_tuned.append(line)
        return Cast(
            satellites=satellites, modes=modes, scenario=scenario, teams=teams, not_tuned=not_tuned, given=given
        )

    def settings(self, cast: Cast) -> dict[str, Any]:
        """Plain values, names in the place of what they were given by."""
        own = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "prepared"}
        policies = dict.fromkeys(policy.name for team in cast.teams.values() for policy in team)
        files = {name: file.name for name, file in vars(self.prepared).items() if file != getattr(Prepared(), name)}
        return {
            **own,
            "scenario": cast.scenario.name,
            "satellites": [satellite.name for satellite in cast.satellites],
            "modes": [label(mode) for mode in cast.modes],
            "policies": list(policies) if self.policies else [],
            "output": portable(str(self.output)),
            **files,
        }


def compare(comparison: Comparison, cast: Cast) -> dict[str, Any]:
    """Fly everything; `records`, `pairs`, `bounds` and `efficiencies` as compare.json has them, and `curves`.

    `bounds` has what each cell allows, `efficiencies` how far each policy gets; there are none where the
    scenario's filter is neither the AdaptiveEKF nor the MomentumEKF, as they are by default. Times of decisions are in
    `efficiencies`: they are no results.
    `curves` has what the report alone needs, errors against time and one episode in full, and is not for compare.json.
    """
    chosen = seeds(comparison.seed_split, comparison.episodes)  # type: ignore[arg-type]
    world = benchmark_scenario(cast.scenario)
    places = list(itertools.product(cast.satellites, cast.modes))
    teams = cast.teams
    records: list[dict[str, Any]] = []
    pairs: list[dict[str, Any]] = []
    bounds: list[dict[str, Any]] = []
    efficiencies: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    limits: list[dict[str, Any]] = []
    with (
        ThreadPoolExecutor(os.cpu_count()) as pool,  # planners leave the interpreter's lock for most of their time
        tqdm(total=sum(len(teams[satellite.name]) for satellite, _ in places), desc="comparing", unit="flight") as bar,
    ):
        cells = [
            Cell.start(pool, teams[satellite.name], satellite=satellite, inertia=mode, seeds=chosen, scenario=world)
            for satellite, mode in places
        ]
        for pending in (flight for cell in cells for flight in cell.flights):
            pending.add_done_callback(lambda done: None if done.cancelled() else bar.update())
        try:
            while cells:
                cell = cells.pop(0)  # let go of its flights as soon as they are scored: all of them take much memory
                where = cell.place
                bar.set_postfix_str(" ".join(where.values()), refresh=False)
                top = cell.ceiling.result() if cell.ceiling else None
                if top is not None:
                    final = top.final_errors()
                    bounds += [{"policy": name, "kind": "bound", **where, "final_error": final[name]} for name in final]
                    series = {"bound": top.bound, "ideal": top.ideal}
                    limits += [{"policy": name, **where, "error": rounded(series[name])} for name in series]
                scores: dict[str, Scores] = {}
                for pilot, pending in zip(cell.pilots, cell.flights, strict=True):
                    flight = pending.result()
                    scores[pilot.name] = flight.scores()
                    entry = {"policy": pilot.name, "kind": pilot.kind, **where, "episodes": len(chosen)}
                    records.append({**entry, **record(scores[pilot.name])})
                    curves.append({"policy": pilot.name, **where, **error_bands(flight.error)})
                    if top is not None:
                        reached = {**top.efficiency(flight.error), "decision_ms": pilot.decision_ms}
                        efficiencies.append({"policy": pilot.name, **where, **reached})
                pairs += [{**match, **where, **result} for match, result in _matches(cell.pilots, scores)]
        except BaseException:
            pool.shutdown(cancel_futures=True)  # who interrupts does not wait for all that was to come
            raise
    shown = episode_cell([satellite.name for satellite in cast.satellites], [label(mode) for mode in cast.modes])
    satellite, mode = next((s, m) for s, m in places if (s.name, label(m)) == shown)
    stars = protagonists([r for r in records if (r["satellite"], r["inertia_mode"]) == shown])
    team = teams[satellite.name]
    episode = fly_episode(team, satellite=satellite, mode=mode, seed=chosen[0], scenario=world, shown=stars)
    instants = world.decision_period * np.arange(1, world.decisions + 1)
    return {
        "command": command("agents.compare"),
        "settings": comparison.settings(cast),
        "revision": revision(),
        "versions": versions(),
        "seeds": {"split": comparison.seed_split, "first": chosen[0], "count": len(chosen)},
        "scenario": world.to_dict(),
        "definitions": cast.definitions(),
        "records": records,
        "pairs": pairs,
        "bounds": bounds,
        "efficiencies": efficiencies,
        "curves": {"time": instants.tolist(), "curves": curves, "bounds": limits, "episode": episode},
    }


def _matches(policies: Sequence[Policy], scores: Mapping[str, Scores]) -> list[tuple[dict[str, str], dict[str, float]]]:
    return [
        ({"policy": one.name, "other": other.name}, pair(scores[one.name], scores[other.name]))
        for one in policies
        if one.kind in CHALLENGERS
        for other in policies
        if other is not one
    ]


def write(results: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the results as JSON and their records as CSV; the paths written."""
    file = folder / file_names(results["settings"]["scenario"])["results"]
    table = io.StringIO()
    writer = csv.DictWriter(table, fieldnames=list(results["records"][0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(results["records"])
    paths = [file, file.with_suffix(".csv")]
    write_json(paths[0], results)
    write_text(paths[1], table.getvalue())
    return paths


def main() -> int:
    """Run the comparison that the command line asks for; the exit code."""
    comparison = tyro.cli(Comparison, description=__doc__)
    start = time.perf_counter()
    with refusal():
        cast = comparison.cast()
    check_writable(comparison.output)
    results = compare(comparison, cast)
    curves = results.pop("curves")
    paths = write(results, comparison.output)
    report = write_report(results, curves, comparison.output)
    first, count = results["seeds"]["first"], results["seeds"]["count"]
    print_comparison(
        results["records"],
        "bold: lowest among those at most 1 % of the time beyond the envelope, of rates and wheel speeds\n"
        "bound: root mean square error that no estimator beats under any excitation inside the envelope; ideal: "
        "that of the best fixed walk, told of steps, if all samples told as much; efficiency: bound / achieved\n"
        + "".join(f"not tuned: {line}\n" for line in cast.not_tuned)
        + f"{results['command']}, revision {results['revision']}, scenario {cast.scenario.name}, "
        f"{comparison.seed_split} seeds {first} to {first + count - 1}\n"
        f"{', '.join(map(str, paths))} written; {time.perf_counter() - start:.0f} s\n"
        f"report, for a browser: {report}",
        results["bounds"],
        results["efficiencies"],
    )
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
