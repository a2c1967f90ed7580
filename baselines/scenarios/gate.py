"""Gate of a scenario: `python -m baselines.scenarios.gate --scenario flex`. Does the choice of excitation matter there?

Flies, by body rates, from nothing to an oracle:

- zero and random;
- the paper's eight profiles, and square waves of rate, each with its best settings inside all limits;
- `shaped_square`, which spares the modes, with its best settings inside all limits;
- an oracle that is told the true modes and searches the settings of each episode by the cross-entropy method.

Settings are chosen on tuning seeds and flown on validation seeds. What is compared is the error that the filter
expects, its mean over the flight, and not the one that is found at its end: of many plans an oracle would else choose a
lucky one. A policy is inside where each cost is at most a limit, in the mean over episodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.scenarios.flights import Cell, Flown, flown
from baselines.scenarios.oracle import search
from baselines.scenarios.rivals import choose, rivals
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, write_json
from satid_gym.gym_api import COSTS
from satid_gym.satellite import SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS


@dataclass(frozen=True, kw_only=True)
class Gate:
    """Settings of the study."""

    scenario: str = "flex"
    """Scenario to judge."""
    satellite: str = "microsat"
    """Satellite that flies in it."""
    inertia: str = "static"
    """Inertia mode."""
    cost: float = 0.01
    """Largest cost of each kind, as a share of the time."""
    tuned: int = 32
    """Episodes that judge a setting, tuning seeds."""
    episodes: int = 64
    """Episodes that are flown, validation seeds."""
    oracle: int = 32
    """Episodes of these that the oracle flies too; 0: no oracle."""
    output: Path = Path("results/gate.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or a number is out of range.
        """
        check_names("scenario", [self.scenario], SCENARIOS)
        check_names("satellite", [self.satellite], SATELLITES)
        check_integer("tuned", self.tuned)
        check_integer("episodes", self.episodes)
        check_integer("oracle", self.oracle, low=0, high=self.episodes)

    @property
    def cell(self) -> Cell:
        """What is flown."""
        return Cell(scenario=self.scenario, satellite=self.satellite, inertia=self.inertia)


def row(name: str, settings: dict[str, float], flight: Flown) -> dict[str, Any]:
    """Line of the table."""
    return {
        "policy": name,
        "settings": settings,
        "episodes": len(flight.error),
        "expected": float(np.mean(flight.expected)) if np.isfinite(flight.expected).all() else None,
        "final_error": float(flight.error.mean()),
        "nees": float(flight.nees.mean()),
        "nees_median": float(np.median(flight.nees)),
        "costs": dict(zip(COSTS, flight.costs.mean(axis=0).tolist(), strict=True)),
        "terminated": float(flight.terminated.mean()),
    }


def show(gate: Gate, rows: list[dict[str, Any]]) -> None:
    """Print a line for each policy, and how the rungs of the ladder compare."""
    heads = ("expected, %", 12), ("final error, %", 15), ("NEES (median)", 14), ("largest cost, %", 22)
    print(f"{'policy':16s} " + " ".join(f"{head:>{width}s}" for head, width in heads) + " ended")
    for own in rows:
        worst = max(own["costs"], key=own["costs"].get)
        expected = "-" if own["expected"] is None else f"{100 * own['expected']:.4f}"
        nees, cost = f"{own['nees']:.2f} ({own['nees_median']:.2f})", f"{worst} {100 * own['costs'][worst]:.2f}"
        print(
            f"{own['policy']:16s} {expected:>12s} {100 * own['final_error']:15.4f} {nees:>14s} "
            f"{cost:>22s} {100 * own['terminated']:4.0f} %"
        )
    inside = [own for own in rows if own["expected"] and max(own["costs"].values()) <= gate.cost]
    named = {own["policy"]: own["expected"] for own in inside}
    print("inside all limits: " + ", ".join(named))


def main_rows(gate: Gate) -> list[dict[str, Any]]:
    """All lines of the table."""
    rows = []
    for name, trials in tqdm(rivals(gate.scenario).items(), desc=gate.scenario, unit="policy"):
        settings, policy = choose(gate.cell, trials, gate.cost, gate.tuned)
        rows.append(row(name, settings, flown(gate.cell, policy, seeds("validation", gate.episodes))))
    if gate.oracle:
        rows.append(row("oracle", {}, search(gate.cell, seeds("validation", gate.oracle), gate.cost)))
    return rows


@cli.on_interrupt("no file is written")
def main(gate: Gate) -> int:
    """Judge the scenario of the command line; returns the exit code."""
    check_writable(gate.output.parent)
    rows = main_rows(gate)
    head = result_head("baselines.scenarios.gate", gate, split="validation", seeds=seeds("validation", gate.episodes))
    write_json(gate.output, {**head, "rows": rows})
    show(gate, rows)
    return 0


if __name__ == "__main__":
    cli.run(main)
