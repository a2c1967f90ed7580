"""Tuning on drawn satellites: `python -m agents.unseen.tune`.

Flies the closed loops with each of their settings on satellites drawn with tuning seeds, one setting for all of them,
and keeps the one with the least mean error, as a geometric mean over satellites and laws, of those that are inside all
limits on 95 % of the satellites; if none is, the one that is on most.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.unseen.flights import Row, episodes_of, flown, inside, world_of
from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.config import check_integer, check_names
from satid_gym.drawn_satellite import draw_satellites
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.registry import PLANNERS, RATE_PLANNERS, build

INSIDE_MIN = 0.95  # share of the satellites
GRIDS: dict[str, dict[str, list[dict[str, Any]]]] = {
    "default": {
        "rate_square": [
            {"period": period, "slews": slews, "margin": 3.5}
            for period, slews in itertools.product((6.0, 9.0, 12.0, 18.0, 24.0), (0.0, 4.0))
        ],
        "corner_tour": [{"hold": hold} for hold in (5.0, 7.0, 10.0, 14.0, 20.0)],
        "mpc": [{"margin": margin} for margin in (2.75, 3.5)],
    },
    "flex": {
        "shaped_square": [
            {"period": period, "share": share, "dwell": 0.5, "amplitude": amplitude}
            for period, share, amplitude in itertools.product((12.0, 24.0), (0.35, 0.5, 0.65, 0.8, 1.0), (0.7, 1.0))
        ],
        "spared_square": [{"period": period} for period in (8.0, 12.0, 16.0, 24.0, 48.0)],
        "filter_mpc": [
            {"horizon": 16, "edits": 24, "tail": 5.0, "caution": caution, "amplitude": amplitude}
            for caution, amplitude in itertools.product((0.0, 1.0, 2.0), (0.7, 1.0))
        ],
    },
}
"""Settings that are tried of each baseline, by scenario."""


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """Settings of the tuning."""

    scenario: str = "default"
    """Scenario to fly in: default or flex."""
    satellites: int = 24
    """Satellites that a setting is flown on."""
    wheels: int = 4
    """Wheels of each, for what is tuned does not depend on it."""
    episodes: int = 2
    """Episodes of each with each law."""
    planned: int = 1
    """Episodes of planners, which are slow, and fly a third of the satellites."""
    output: Path | None = None
    """File to write. Default: results/unseen_tuned_SCENARIO.json."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a number is out of range, or nothing is tuned in the scenario.
        """
        check_names("scenario", [self.scenario], GRIDS)
        for name in ("satellites", "wheels", "episodes", "planned"):
            check_integer(name, getattr(self, name))


def tried(tuning: Tuning, name: str, settings: dict[str, Any]) -> list[Row]:
    """Flights of one setting."""
    count = -(-tuning.satellites // 3) if name in (*PLANNERS, *RATE_PLANNERS) else tuning.satellites
    policy, episodes = build(name, settings), episodes_of(name, tuning.episodes, tuning.planned)
    world = world_of(tuning.scenario, "tuning")
    return [
        flown(policy, world, satellite, inertia, seeds("tuning", episodes, 1000 * i))
        for i, satellite in enumerate(draw_satellites(seeds("tuning", count), wheels=tuning.wheels))
        for inertia in INERTIA_MODES
    ]


@cli.on_interrupt("no file is written")
def main(tuning: Tuning) -> int:
    """Tune; the exit code."""
    output = tuning.output or Path("results") / f"unseen_tuned_{tuning.scenario}.json"
    check_writable(output.parent)
    entries: dict[str, list[dict[str, Any]]] = {}
    for name, grid in GRIDS[tuning.scenario].items():
        for settings in tqdm(grid, desc=name, unit="setting"):
            rows = tried(tuning, name, settings)
            error = float(np.exp(np.mean([np.log(np.mean(row["mean_error"])) for row in rows])))
            entries.setdefault(name, []).append(
                {"settings": settings, "mean_error": error, "inside": inside(rows, name, "cost")}
            )
    chosen = {}
    for name, found in entries.items():
        enough = min(INSIDE_MIN, max(entry["inside"] for entry in found))
        allowed = [entry for entry in found if entry["inside"] >= enough]
        chosen[name] = min(allowed, key=lambda entry: entry["mean_error"])["settings"]
        for entry in sorted(found, key=lambda entry: entry["mean_error"])[:10]:
            numbers = f"{100 * entry['mean_error']:.4f} %, inside all limits on {entry['inside']:.2f}"
            print(f"{name:14s} {numbers} {entry['settings']}")
    head = result_head("agents.unseen.tune", tuning, split="tuning", seeds=seeds("tuning", tuning.satellites))
    write_json(output, {**head, "chosen": chosen, "tried": entries})
    return 0


if __name__ == "__main__":
    cli.run(main)
