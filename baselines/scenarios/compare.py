"""Comparison in a scenario: `python -m baselines.scenarios.compare --policy stargazer`.

Flies a learned policy and its rivals on the same test seeds, by body rates, in cells of satellites and inertia modes.
Each rival has for each satellite the settings that tuning seeds and random inertia laws give inside all limits, as in
the gate. Of the paper's eight profiles, and of square waves of rate, the best one on these seeds flies, as `waveform`.

What is compared is the error that the filter expects, its mean over the flight, and the one that is found at its end,
both in units of the rotors' mean inertia. One policy is lower than another where the paired 95 % interval of the
difference is below zero.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.scenarios.flights import Cell, Flown, flown
from baselines.scenarios.rivals import Trial, choose, rivals
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.evaluation import FIRST_SEED, Split, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.gym_api import COSTS
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import bootstrap
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.shipped import find
from satid_gym.profiles import PROFILES
from satid_gym.satellite import SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS

WAVEFORM = "waveform"
WAVEFORMS = (*PROFILES, "rate_square")
MEASURES = ("expected", "error")
Row = dict[str, Any]  # a policy in a cell: its settings, and a list of episodes of each score


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Settings of the comparison."""

    policy: str
    """Learned policy: name of a shipped one, path of a policy's files or of a run, or NAME=PATH."""
    scenario: str = "calibration"
    """Scenario to fly in."""
    satellites: tuple[str, ...] = ("cubesat", "microsat", "smallsat")
    """Satellites to fly."""
    inertias: tuple[str, ...] = INERTIA_MODES
    """Inertia modes to fly."""
    rivals: tuple[str, ...] = (WAVEFORM, "swing_and_stop", "mpc")
    """What flies next to it: `waveform`, or policies of the gate by name."""
    cost: float = 0.01
    """Largest cost of each kind, as a share of the time."""
    tuned: int = 8
    """Episodes that judge a setting, tuning seeds."""
    episodes: int = 32
    """Episodes of each cell."""
    split: Split = "test"
    """Seeds of these: test, or validation to choose by."""
    output: Path = Path("results/scenario.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown, or a number is out of range.
        """
        check_names("scenario", [self.scenario], SCENARIOS)
        check_names("satellite", self.satellites, SATELLITES)
        check_names("inertia mode", self.inertias, INERTIA_MODES)
        check_names("rival", self.rivals, (WAVEFORM, *rivals(self.scenario)))
        check_names("split of seeds", [self.split], FIRST_SEED)
        check_number("cost", self.cost, high=1.0)
        check_integer("tuned", self.tuned)
        check_integer("episodes", self.episodes)
        if self.learned().name in self.rivals:
            raise ValueError(f"a rival has the name {self.learned().name!r}: give the policy another, NAME=PATH")

    def learned(self) -> LearnedPolicy:
        """The policy."""
        return find(self.policy)

    def chosen(self, satellite: str) -> dict[str, Trial]:
        """Each rival with its settings for a satellite."""
        cell = Cell(scenario=self.scenario, satellite=satellite, inertia="random")
        return {name: choose(cell, trials(self.scenario, name), self.cost, self.tuned) for name in self.rivals}


def trials(scenario: str, rival: str) -> list[Trial]:
    """Settings to try of a rival; those of waveforms say which one."""
    known = rivals(scenario)
    if rival != WAVEFORM:
        return known[rival]
    return [({"kind": name, **given}, policy) for name in WAVEFORMS for given, policy in known[name]]  # type: ignore[dict-item]


def row_of(cell: Cell, name: str, settings: dict[str, Any], flight: Flown) -> Row:
    """What is kept of the flights of a policy in a cell."""
    return {
        "satellite": cell.satellite,
        "inertia": cell.inertia,
        "policy": name,
        "settings": settings,
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


def summary(rows: list[Row], first: str) -> list[dict[str, Any]]:
    """One entry a cell and policy: means, and the first policy over it."""
    found = []
    for row in rows:
        (own,) = [r for r in rows if r["policy"] == first and all(r[k] == row[k] for k in ("satellite", "inertia"))]
        entry = {name: row[name] for name in ("satellite", "inertia", "policy", "settings", "terminated")}
        entry |= {score: float(np.mean(row[score])) for score in (*MEASURES, "nees")}
        found.append({**entry, "largest_cost": max(row["costs"].values()), "first_over_it": against(own, row)})
    return found


def show(entries: list[dict[str, Any]], first: str) -> None:
    """Print a line for each cell and policy."""
    print(f"{'':38s} expected, %  error at the end, %  NEES  largest cost, %  {first} over it: expected, error")
    for e in entries:
        over = "  ".join(
            f"{e['first_over_it'][m]['ratio']:.3f} {['level', 'higher', 'lower'][e['first_over_it'][m]['clear']]}"
            for m in MEASURES
        )
        print(
            f"{e['satellite']:10s}{e['inertia']:10s}{e['policy']:18s} {100 * e['expected']:11.4f} "
            f"{100 * e['error']:20.4f} {e['nees']:5.2f} {100 * e['largest_cost']:16.2f}  {over}"
        )


@cli.on_interrupt("what was flown is in the file")
def main(settings: Comparison) -> int:
    """Fly and print; the file is written after every cell. The exit code."""
    check_writable(settings.output.parent)
    policy = settings.learned()
    flown_seeds = seeds(settings.split, settings.episodes)
    given = dataclasses.asdict(settings)
    head = result_head("baselines.scenarios.compare", given, split=settings.split, seeds=flown_seeds)
    rows: list[Row] = []
    for satellite in settings.satellites:
        flies = {policy.name: ({}, policy), **settings.chosen(satellite)}
        for inertia in tqdm(settings.inertias, desc=satellite, unit="cell"):
            cell = Cell(scenario=settings.scenario, satellite=satellite, inertia=inertia)
            rows += [row_of(cell, name, used, flown(cell, p, flown_seeds)) for name, (used, p) in flies.items()]
            write_json(settings.output, {**head, "summary": summary(rows, policy.name), "rows": rows})
    show(summary(rows, policy.name), policy.name)
    return 0


if __name__ == "__main__":
    cli.run(main)
