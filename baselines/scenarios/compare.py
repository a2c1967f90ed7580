"""Comparison in pairs: `python -m baselines.scenarios.compare --policies lookahead stargazer`.

Flies policies and rivals on the same test seeds, by body rates, in cells of one scenario. Rivals, and policies that are
rivals of the scenario, have the settings that `baselines.scenarios.tune` found for each satellite.

What is compared is the error that the filter expects, its mean over the flight, and the one that is found at its end,
both in units of the rotors' mean inertia. One policy is lower than another where the paired 95 % interval of the
difference is below zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cells, cli
from baselines.command.provenance import result_head
from baselines.scenarios.flights import Cell, Flown, flown
from baselines.scenarios.rivals import Trial, rivals
from baselines.scenarios.tune import JUDGED, tuned_rival
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import FIRST_SEED, Split, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.gym_api import COSTS
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import bootstrap
from satid_gym.policies.custom import digest, find_any
from satid_gym.satellite import BENCHMARK_SATELLITES

MEASURES = ("expected", "error")
Row = dict[str, Any]  # a policy in a cell: its settings, and a list of episodes of each score


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Settings of the comparison."""

    policies: tuple[str, ...]
    """Policies to judge: rivals of the scenario and shipped ones by name, paths of a policy's files or of a run,
    module:name (runs the module's code), or NAME= before either of the two."""
    rivals: tuple[str, ...] = ()
    """Rivals to fly next to them; all of the scenario where none is named."""
    scenario: str = "calibration"
    """Scenario to fly in."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    inertias: tuple[str, ...] = INERTIA_MODES
    """Inertia modes to fly."""
    episodes: int = 32
    """Episodes of each cell."""
    split: Split = "test"
    """Seeds of these: test, or validation to choose by."""
    again: bool = False
    """Fly again what the file has."""
    output: Path | None = None
    """File to write, by default results/pairs_SCENARIO.json; what it holds of the same comparison is not flown
    again."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or taken, a number is out of range, or a rival is not tuned.
        """
        check_names("scenario", [self.scenario], JUDGED)
        check_names("satellite", self.satellites, BENCHMARK_SATELLITES)
        check_names("inertia mode", self.inertias, INERTIA_MODES)
        check_names("rival", self.rivals, rivals(self.scenario))
        check_names("split of seeds", [self.split], FIRST_SEED)
        check_integer("episodes", self.episodes, low=2)
        for satellite in self.satellites:
            self.entrants(satellite)

    @property
    def file(self) -> Path:
        """File to write."""
        return self.output or Path(f"results/pairs_{self.scenario}.json")

    def judged(self) -> list[str]:
        """Names of the policies to judge."""
        known = rivals(self.scenario)
        return [text if text in known else find_any(text).name for text in self.policies]

    def identities(self) -> dict[str, str]:
        """What decides the flights of policies that are no rivals, `digest` by name; rows have the rivals' settings."""
        own = [find_any(text) for text in self.policies if text not in rivals(self.scenario)]
        return {policy.name: digest(policy) for policy in own}

    def entrants(self, satellite: str) -> dict[str, Trial]:
        """Settings and policy of all that fly a satellite, by name.

        Raises:
            ValueError: two have the same name, one is unknown, or a rival is not tuned.
        """
        known, found = rivals(self.scenario), {}
        texts = dict.fromkeys((*self.policies, *(self.rivals or known)))
        for text in texts:
            settings, policy = tuned_rival(self.scenario, satellite, text) if text in known else ({}, find_any(text))
            name = text if text in known else policy.name
            if name in found or (name != text and name in texts):
                raise ValueError(f"two policies have the name {name!r}: give one another, NAME={text}")
            found[name] = settings, policy
        return found


def row_of(cell: Cell, name: str, settings: dict[str, Any], flight: Flown) -> Row:
    """What is kept of the flights of a policy in a cell."""
    return {
        "satellite": cell.satellite,
        "inertia": cell.inertia,
        "policy": name,
        "settings": dict(settings),
        "costs": dict(zip(COSTS, flight.costs.mean(axis=0).tolist(), strict=True)),
        "terminated": int(flight.terminated.sum()),
        **{score: [float(f"{v:.5g}") for v in getattr(flight, score)] for score in (*MEASURES, "nees")},
    }


def against(own: Row, other: Row) -> dict[str, Any]:
    """One policy over another in their cell, by measure: ratio of means, and whether the paired difference is clear.

    `clear` is -1 where the first is lower beyond the 95 % interval, 1 where it is higher, else 0.
    """
    found: dict[str, Any] = {}
    for measure in MEASURES:
        mine, theirs = np.array(own[measure]), np.array(other[measure])
        low, high = bootstrap(mine - theirs) if np.isfinite([mine, theirs]).all() else (-np.inf, np.inf)
        found[measure] = {"ratio": float(mine.mean() / theirs.mean()), "clear": int(low > 0.0) - int(high < 0.0)}
    return found


def by_cell(rows: Sequence[Row]) -> Iterator[dict[str, Row]]:
    """The rows of each cell, by policy."""
    for cell in dict.fromkeys((row["satellite"], row["inertia"]) for row in rows):
        yield {row["policy"]: row for row in rows if (row["satellite"], row["inertia"]) == cell}


def show(rows: Sequence[Row], judged: Sequence[str]) -> None:
    """Print a line for each cell and policy: its scores, and the judged policies over it."""
    over = "".join(f"  {name + ' over it':>26s}" for name in judged)
    print(f"{'':38s} expected, %  error at the end, %  NEES  largest cost, %{over}")
    for cell in by_cell(rows):
        for row in cell.values():
            expected, error, nees = (np.mean(row[name]) for name in ("expected", "error", "nees"))
            print(
                "{satellite:10s}{inertia:10s}{policy:18s}".format(**row)
                + f"{100.0 * expected:12.4f} {100.0 * error:20.4f} {nees:5.2f}"
                + f" {100 * max(row['costs'].values()):16.2f}"
                + "".join(f"  {_words(against(cell[name], row)) if name in cell else '':>26s}" for name in judged)
            )


def _words(over: dict[str, Any]) -> str:
    said = (f"{over[m]['ratio']:.3f} {['level', 'higher', 'lower'][over[m]['clear']]}" for m in MEASURES)
    return ", ".join(said)


@cli.on_interrupt(cells.GOES_ON)
def main(settings: Comparison) -> int:
    """Fly and print; the file is written after every policy. The exit code."""
    file, chosen = settings.file, seeds(settings.split, settings.episodes)
    check_writable(file.parent)
    used = {**vars(settings), "identities": settings.identities()}
    head = result_head("baselines.scenarios.compare", used, split=settings.split, seeds=chosen, output=file)
    with cli.user_errors():
        rows = cells.kept(file, head, "rows", again=settings.again)
    have = {(row["satellite"], row["inertia"], row["policy"]) for row in rows}
    todo = [
        (Cell(scenario=settings.scenario, satellite=satellite, inertia=inertia), name, *trial)
        for satellite in settings.satellites
        for inertia in settings.inertias
        for name, trial in settings.entrants(satellite).items()
        if (satellite, inertia, name) not in have
    ]
    for cell, name, used, policy in (bar := tqdm(todo, desc=settings.scenario, unit="flight")):
        bar.set_postfix_str(f"{cell.satellite} {cell.inertia} {name}")
        rows.append(row_of(cell, name, dict(used), flown(cell, policy, chosen)))
        write_json(file, {**head, "rows": rows})
    show(rows, settings.judged())
    return 0


if __name__ == "__main__":
    cli.run(main)
