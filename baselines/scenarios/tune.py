"""Settings of the rivals in every scenario: `python -m baselines.scenarios.tune`.

For each scenario and satellite each rival gets the settings with the least expected error on tuning seeds, under random
inertia laws, of those inside all limits; see `baselines.scenarios.rivals.choose`. The file is written after each of
them: stopped, the same command goes on where it was.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from baselines.command import cells, cli
from baselines.command.cluster import RayAddress, executor
from baselines.command.provenance import result_head
from baselines.scenarios.flights import Cell
from baselines.scenarios.rivals import Trial, choose, rivals
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.files import check_writable, read_json, write_json
from satid_gym.policies.open_loop_optimal import NotPreparedError
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS

TUNED = Path(__file__).with_name("tuned.json")
JUDGED = tuple(name for name in SCENARIOS if name != "paper")
"""Scenarios whose rivals are tuned: all but the paper's, which has a study of its own."""
Entry = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """What to tune."""

    scenarios: tuple[str, ...] = JUDGED
    """Scenarios to fly in."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    policies: tuple[str, ...] = ()
    """Rivals to tune; all that a scenario has where none is named."""
    cost: float = 0.01
    """Largest cost of each kind, as a share of the time."""
    episodes: int = 8
    """Episodes that judge a setting."""
    again: bool = False
    """Tune again what the file has."""
    output: Path = TUNED
    """File to go on with."""
    ray: RayAddress = None
    """Tune on a Ray cluster: auto, HOST:PORT, ray://HOST:PORT, or local for one of this machine."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown, or a number is out of range.
        """
        check_names("scenario", self.scenarios, JUDGED)
        check_names("satellite", self.satellites, SATELLITES)
        if self.policies:
            check_names("rival", self.policies, {name for scenario in self.scenarios for name in rivals(scenario)})
        check_number("cost", self.cost, high=1.0)
        check_integer("episodes", self.episodes)


def best(scenario: str, satellite: str, name: str, cost: float, episodes: int) -> Entry:
    """The best settings of a rival, and how they were found."""
    trials = rivals(scenario)[name]
    cell = Cell(scenario=scenario, satellite=satellite, inertia="random")
    settings, _ = choose(cell, trials, cost, episodes, num_threads=1)  # rivals fly side by side
    found = {"scenario": scenario, "satellite": satellite, "policy": name, "settings": settings}
    return {**found, "tried": len(trials), "cost": cost, "episodes": episodes}


def stored(file: Path) -> list[Entry]:
    """Entries of a file; none where there is no file.

    Raises:
        DamagedFileError: it holds no settings.
    """
    if not file.exists():
        return []
    entries: list[Entry] = read_json(file, "python -m baselines.scenarios.tune writes it", keys=["entries"])["entries"]
    return entries


@functools.cache
def _settings(file: Path) -> Mapping[tuple[str, str, str], dict[str, Any]]:
    return {_key(entry): entry["settings"] for entry in stored(file)}


def tuned(scenario: str, satellite: str, file: Path = TUNED) -> dict[str, Trial]:
    """All rivals by name, with the settings of a file, or with the only ones that are tried.

    Raises:
        NotPreparedError: the file has none for one of them, or those of an older grid.
        DamagedFileError: it holds no settings.
    """
    return {name: tuned_rival(scenario, satellite, name, file) for name in rivals(scenario)}


def tuned_rival(scenario: str, satellite: str, name: str, file: Path = TUNED) -> Trial:
    """One of the rivals of a scenario; see `tuned`."""
    trials = rivals(scenario)[name]
    if len(trials) == 1:
        return trials[0]
    settings = _settings(file).get((scenario, satellite, name))
    command = f"python -m baselines.scenarios.tune --scenarios {scenario} --satellites {satellite} --policies {name}"
    if settings is None:
        raise NotPreparedError(
            f"{name} is not tuned for satellite {satellite!r} in scenario {scenario!r}: run {command}"
        )
    for own, policy in trials:
        if own == settings:
            return own, policy
    raise NotPreparedError(
        f"{name} is not tried with {dict(settings)} in scenario {scenario!r} any longer: run {command} --again"
    )


def _key(entry: Mapping[str, Any]) -> tuple[str, str, str]:
    return entry["scenario"], entry["satellite"], entry["policy"]


def lacking(tuning: Tuning, known: Mapping[tuple[str, str, str], Entry]) -> list[tuple[str, str, str]]:
    """Scenario, satellite and rival of what is to be tuned: of what has more than one setting to try.

    Raises:
        ValueError: a known entry was found with another cost or number of episodes.
    """
    asked = [
        (scenario, satellite, name)
        for scenario, satellite in itertools.product(tuning.scenarios, tuning.satellites)
        for name, trials in rivals(scenario).items()
        if len(trials) > 1 and name in (tuning.policies or [name])
    ]
    if tuning.again:
        return asked
    for place in asked:
        if place in known:
            entry = {"cost": Tuning.cost, **known[place]}  # older entries are all of this cost
            what = f"{' '.join(place)} of {tuning.output}"
            cells.check_same(what, entry, {"cost": tuning.cost, "episodes": tuning.episodes})
    return [place for place in asked if place not in known]


@cli.on_interrupt("what was tuned is in the file; a command without --again goes on with what it lacks")
def main(tuning: Tuning) -> int:
    """Tune what the command line asks for; the exit code."""
    check_writable(tuning.output.parent)
    entries = {_key(entry): entry for entry in stored(tuning.output)}
    with cli.user_errors():
        todo = lacking(tuning, entries)
    head = result_head("baselines.scenarios.tune", output=tuning.output)
    with executor(tuning.ray) as pool, tqdm(total=len(todo), desc="tuning", unit="rival") as bar:
        for done in as_completed([pool.submit(best, *place, tuning.cost, tuning.episodes) for place in todo]):
            entry = {**done.result(), "revision": head["revision"]}
            entries[_key(entry)] = entry
            bar.set_postfix_str(" ".join(_key(entry)), refresh=False)
            bar.update()
            write_json(tuning.output, {**head, "entries": [entries[key] for key in sorted(entries)]})
    for key in sorted(entries):
        print(f"{key[0]:12s} {key[1]:10s} {key[2]:16s} {entries[key]['settings']}")
    return 0


if __name__ == "__main__":
    cli.run(main)
