"""Benchmark: learned against scripted and closed-loop policies on 3 satellites x 4 inertia modes, held-out episodes.

Prints tables and writes compare.json, compare.csv and the page report.html. All policies of a cell fly the same
truth and the same noise; the inertia follows the paper's laws; the test seeds were used by neither tuning nor
training. The planners, which take most of the time, fly with --all; without it their stored figures are shown where
they are of the same episodes, marked and with the revision that made them.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from agents.benchmark.entrants import Entrants, find_entrants
from agents.benchmark.flights import fly_cells, fly_shown_episode, instants
from agents.benchmark.report import write_report
from agents.benchmark.results import files_of
from agents.benchmark.stored import candidates, find_stored, keep_planners, with_stored
from agents.benchmark.summary.tables import print_comparison
from baselines.command import cli
from baselines.command.cluster import RayAddress
from baselines.command.options import ScenarioText
from baselines.command.provenance import portable, result_head
from baselines.tuning.prepared import Prepared
from satid_gym.config import check_names
from satid_gym.evaluation import FIRST_SEED, benchmark_scenario, seeds
from satid_gym.files import check_writable, write_json, write_text
from satid_gym.laws import INERTIA_MODES
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.selection import label, select_inertias, select_satellites, select_scenario

_BOUNDS = (
    "bound: root mean square error that no estimator beats under any excitation inside the envelope; "
    "reference_limit: that of the best fixed process noise, told of steps, if all samples told as much; "
    "efficiency: bound / achieved"
)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What to compare."""

    scenario: ScenarioText = "default"
    """The world: a name, a .json or .toml file, or module:name (runs the module's code)."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly: names, .json or .toml files, or module:name (runs the module's code)."""
    modes: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["--inertias"])] = INERTIA_MODES
    """How their inertia varies: modes, laws as .json, .toml or .csv files, or module:name (runs the module's code)."""
    policies: tuple[str, ...] = ()
    """Policies to compare: names, paths of a policy's files or of a run's folder, module:name (runs the module's
    code), or NAME= before either of the two; where none is named all that come with the project, planners excepted."""
    all: tyro.conf.FlagCreatePairsOff[bool] = False
    """Fly the planners too; this takes five times as long."""
    control: Literal["torque", "rate"] = "torque"
    """What actions are: torque of each wheel, or body rates, with the baselines of the standing table. Those that are
    not tuned for a satellite or scenario then fly with their default settings."""
    prepared: Annotated[Prepared, tyro.conf.arg(name="")] = field(default_factory=Prepared)
    episodes: int = 100
    """Episodes of each policy in each cell."""
    seed_split: Annotated[str, tyro.conf.arg(aliases=["--split"])] = "test"
    """Which seeds: training, tuning, validation or test."""
    output: Path = Path("results")
    """Folder for what is written; scenarios other than default add their name to the files'."""
    ray: RayAddress = None
    """Fly on a Ray cluster: auto, HOST:PORT, ray://HOST:PORT, or local for one of this machine."""

    def entrants(self) -> Entrants:
        """The cells and policies that names, files and modules stand for.

        Raises:
            ValueError: a name is unknown or taken by another, what a file holds is not valid, a baseline that was
                named has no settings for a satellite, or the number of episodes is below 2.
            DamagedFileError: a file of settings of baselines is missing or holds none.
        """
        scenario = select_scenario(self.scenario)
        satellites = select_satellites(self.satellites)
        modes = select_inertias(self.modes)
        check_names("split of seeds", (self.seed_split,), FIRST_SEED)
        if self.episodes < 2:
            raise ValueError(f"episodes must be at least 2 for an interval, got {self.episodes}")
        if self.all and self.policies:
            raise ValueError("give either --policies or --all, which is all that come with the project")
        return find_entrants(
            satellites=dict(zip(self.satellites, satellites, strict=True)),
            modes=modes,
            scenario=(self.scenario, scenario),
            control=self.control,
            policies=self.policies,
            prepared=self.prepared,
            planners=self.all,
        )

    def settings(self, entrants: Entrants) -> dict[str, Any]:
        """Plain values, names in the place of the texts that they were given by."""
        names = [field.name for field in dataclasses.fields(self) if field.name not in ("prepared", "ray")]
        own = {name: getattr(self, name) for name in names}
        policies = dict.fromkeys(policy.name for team in entrants.policies_for.values() for policy in team)
        files = {name: file.name for name, file in vars(self.prepared).items() if file != getattr(Prepared(), name)}
        return {
            **own,
            "scenario": entrants.scenario.name,
            "satellites": [satellite.name for satellite in entrants.satellites],
            "modes": [label(mode) for mode in entrants.modes],
            "policies": list(policies) if self.policies else [],
            "output": portable(str(self.output)),
            **files,
        }


def compare(comparison: Comparison, entrants: Entrants) -> dict[str, Any]:
    """Fly everything; results as compare.json has them, and `curves`.

    `records`, `pairs`, `bounds` and `efficiencies` are as of `flights.Tables`. `stored` has the planners' figures from
    an earlier comparison, see `stored.find_stored`, where all policies but these fly; else it is None.
    `curves` has what the report alone needs, errors against time and one episode in full, and is not for compare.json.
    """
    chosen = seeds(comparison.seed_split, comparison.episodes)  # type: ignore[arg-type]
    tables = fly_cells(entrants, chosen, comparison.ray)
    results = {
        **result_head("agents.compare", comparison.settings(entrants), split=comparison.seed_split, seeds=chosen),
        "scenario": benchmark_scenario(entrants.scenario).to_dict(),
        "definitions": entrants.definitions(),
        "records": tables.records,
        "pairs": tables.pairs,
        "bounds": tables.bounds,
        "efficiencies": tables.efficiencies,
    }
    plain = not comparison.policies and not comparison.all and comparison.control == "torque"
    files = candidates(comparison.output, entrants.scenario.name)
    return {
        **results,
        "stored": find_stored(files, results) if plain else None,
        "curves": {
            "time": instants(entrants),
            "curves": tables.curves,
            "bounds": tables.limits,
            "episode": fly_shown_episode(entrants, tables.records, chosen[0]),
        },
    }


def write(results: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the results as JSON and their records as CSV; the paths written."""
    file = folder / files_of(results)["results"]
    table = io.StringIO()
    writer = csv.DictWriter(table, fieldnames=list(results["records"][0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(results["records"])
    paths = [file, file.with_suffix(".csv")]
    write_json(paths[0], results)
    write_text(paths[1], table.getvalue())
    return paths


def main(comparison: Comparison) -> int:
    """Run the comparison that the command line asks for; the exit code."""
    start = time.perf_counter()
    with cli.user_errors():
        entrants = comparison.entrants()
    check_writable(comparison.output)
    results = compare(comparison, entrants)
    curves = results.pop("curves")
    kept = keep_planners(comparison.output, results)
    paths = write(results, comparison.output)
    report = write_report(results, curves, comparison.output)
    shown = with_stored(results)
    first, count = results["seeds"]["first"], results["seeds"]["count"]
    lines = [
        "bold: lowest among those at most 1 % of the time beyond the envelope, of rates and wheel speeds",
        *([_BOUNDS] if results["bounds"] else []),
        *stored_lines(results["stored"]),
        *entrants.notes(),
        f"{results['command']}, revision {results['revision']}, scenario {entrants.scenario.name}, "
        f"{comparison.seed_split} seeds {first} to {first + count - 1}",
        *([f"the planners' figures that were in {comparison.output} are kept in {kept}"] if kept else []),
        f"{', '.join(map(str, paths))} written; {time.perf_counter() - start:.0f} s",
        f"report, for a browser: {report}",
    ]
    print_comparison(shown["records"], "\n".join(lines), results["bounds"], results["efficiencies"])
    return 0


def stored_lines(stored: Mapping[str, Any] | None) -> list[str]:
    """What is to be said of stored figures under the tables."""
    if stored is None:
        return []
    made = f"(stored): not flown now, but of {stored['file']}, revision {stored['revision']}; --all flies these too"
    return [*([made] if stored["records"] else []), *stored["notes"]]
