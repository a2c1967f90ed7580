"""Comparison on unseen satellites: `python -m agents.unseen.compare`.

Flies policies on satellites, in `flex` with panels, drawn with seeds that neither training nor tuning used, of 3 to 8
wheels and any size, with each inertia law, by body rates and with the full tensor. Prints, policy by policy, its errors
over those of the first one (median, 95th percentile over satellites), and on how many satellites it keeps each limit.
The planner is slow and flies fewer episodes by default; a ratio is of the episodes that both have flown. The file is
written after every satellite, and the same command goes on after a stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.unseen.flights import LIMITS, Row, by_satellite, episodes_of, flown, inside, policy_of, ratios, world_of
from agents.unseen.tune import GRIDS
from baselines.command import cells, cli
from baselines.command.provenance import result_head
from satid_gym.config import check_integer, check_names
from satid_gym.drawn_satellite import SatelliteRanges, draw_satellites
from satid_gym.evaluation import FIRST_SEED, Split, seeds
from satid_gym.files import check_writable, read_json, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.custom import digest
from satid_gym.policy import Policy
from satid_gym.satellite import Satellite

_EPISODES_MAX = 1000  # of a satellite, whose seeds are its own
_LEARNED = {"default": ("rigid_tour", "universal"), "flex": ("panel_tour",)}


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """Settings of the comparison."""

    policies: tuple[str, ...] = ()
    """Learned policies by name or path, and baselines that were tuned; others are compared with the first. Default: the
    learned policies made for the scenario, and all baselines that were tuned."""
    scenario: str = "default"
    """Scenario to fly in: default or flex."""
    satellites: int = 200
    """Number of satellites to draw."""
    wheels: tuple[int, int] = SatelliteRanges().wheels
    """Least and largest number of their wheels. Each number is compiled by itself, which takes a minute or two."""
    episodes: int = 4
    """Episodes with each inertia law."""
    planned: int = 1
    """Episodes of a planner with each inertia law."""
    split: Split = "test"
    """Seeds of satellites and episodes: test, or validation to choose by."""
    tuned: Path | None = None
    """Settings of baselines, of `python -m agents.unseen.tune`. Default: docs/results/unseen_tuned_SCENARIO.json."""
    again: bool = False
    """Fly again what the file has."""
    output: Path = Path("results/unseen.json")
    """File to write; what it holds of the same comparison is not flown again."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a number is out of range, a split or policy is unknown, or the baselines were tuned elsewhere.
        """
        check_integer("satellites", self.satellites)
        for name in ("episodes", "planned"):
            check_integer(name, getattr(self, name), high=_EPISODES_MAX)
        check_names("split of seeds", [self.split], FIRST_SEED)
        check_names("scenario", [self.scenario], GRIDS)
        SatelliteRanges(wheels=self.wheels)
        self.entrants()

    def drawn(self) -> tuple[Satellite, ...]:
        """The satellites."""
        return draw_satellites(seeds(self.split, self.satellites), SatelliteRanges(wheels=self.wheels))

    def entrants(self) -> dict[str, Policy]:
        """The policies by name.

        Raises:
            ValueError: one is unknown, or two have a name.
        """
        chosen = self.chosen()
        names = self.names(chosen)
        found = {policy.name: policy for policy in (policy_of(name, chosen) for name in names)}
        if len(found) < len(names):
            raise ValueError(f"policies must have different names, got {names}: give one another, NAME=PATH")
        return found

    def names(self, chosen: Mapping[str, Any]) -> tuple[str, ...]:
        """What flies, where these baselines were tuned."""
        first, *others = _LEARNED[self.scenario]
        return self.policies or (first, *chosen, *others)

    def chosen(self) -> dict[str, dict[str, Any]]:
        """Settings of the baselines that were tuned.

        Raises:
            ValueError: they were tuned in another scenario.
            DamagedFileError: the file holds none.
        """
        command = f"python -m agents.unseen.tune --scenario {self.scenario}"
        file = self.tuned or Path(f"docs/results/unseen_tuned_{self.scenario}.json")
        held = read_json(file, f"run {command}", keys=("settings", "chosen"))
        flown_in = held["settings"].get("scenario", "default")  # older files have none
        if flown_in != self.scenario:
            raise ValueError(f"{file} was tuned in scenario {flown_in}: give --tuned a file of {command}")
        return dict(held["chosen"])

    def identities(self) -> dict[str, Any]:
        """What decides the flights of each policy: settings of a baseline that was tuned, else `digest`."""
        chosen, entrants = self.chosen(), self.entrants()
        names = self.names(chosen)
        return {p.name: chosen.get(text) or digest(p) for text, p in zip(names, entrants.values(), strict=True)}


def summary(rows: list[Row], first: str) -> list[dict[str, Any]]:
    """One entry a policy: errors over the first policy's, and shares of the satellites that it is inside on."""
    found = []
    for name in dict.fromkeys(row["policy"] for row in rows):
        entry: dict[str, Any] = {"policy": name, "satellites": len(by_satellite(rows, name, "mean_error"))}
        for score in ("mean_error", "final_error"):
            own = np.array(list(by_satellite(rows, name, score).values()))
            ratio = ratios(rows, first, name, score)
            entry[score] = float(np.exp(np.log(own).mean()))
            entry[f"{first}_over_it_{score}"] = {
                "median": float(np.median(ratio)),
                "percentile_95": float(np.quantile(ratio, 0.95)),
            }
        for score in LIMITS:
            entry[f"at_most_1_percent_{score}"] = inside(rows, name, score)
        flights = [ended for row in rows if row["policy"] == name for ended in row["terminated"]]
        entry["flights"], entry["ended_early"] = len(flights), int(np.sum(flights))
        entry["nees"] = float(np.mean(list(by_satellite(rows, name, "nees").values())))
        found.append(entry)
    return found


def show(entries: list[dict[str, Any]], first: str) -> None:
    """Print a line a policy."""
    print(
        f"{'':14s} satellites  mean error, %  {first} over it: median, 95th  final: median, 95th  "
        "rates, wheels, all limits kept; ended early"
    )
    for entry in entries:
        shown = [
            entry[f"{first}_over_it_{score}"][name]
            for score in ("mean_error", "final_error")
            for name in ("median", "percentile_95")
        ]
        print(
            f"{entry['policy']:14s} {entry['satellites']:10d}  {100 * entry['mean_error']:13.4f}"
            + "".join(f"  {value:10.3f}" for value in shown)
            + "".join(f"  {100 * entry[f'at_most_1_percent_{what}']:6.1f} %" for what in LIMITS)
            + f"  {entry['ended_early']} of {entry['flights']}"
        )


def main(settings: Unseen) -> int:
    """Fly what is not in the file yet, and print; the exit code."""
    check_writable(settings.output.parent)
    with cli.user_errors():
        policies = settings.entrants()
        chosen = seeds(settings.split, settings.satellites)
        used = {**vars(settings), "identities": settings.identities()}
        head = result_head("agents.unseen.compare", used, split=settings.split, seeds=chosen, output=settings.output)
        rows = cells.kept(settings.output, head, "rows", again=settings.again)
    first, world = next(iter(policies)), world_of(settings.scenario, settings.split)
    done = {(row["satellite"], row["policy"]) for row in rows}
    with cli.on_interrupt(cells.GOES_ON):
        for i, satellite in enumerate(tqdm(settings.drawn(), desc="unseen", unit="satellite")):
            missing = [policy for policy in policies.values() if (satellite.name, policy.name) not in done]
            for policy in missing:
                count = episodes_of(policy.name, settings.episodes, settings.planned)
                rows += [
                    flown(policy, world, satellite, inertia, seeds(settings.split, count, (i + 1) * _EPISODES_MAX))
                    for inertia in INERTIA_MODES
                ]
            if missing:
                write_json(settings.output, {**head, "summary": summary(rows, first), "rows": rows})
    show(summary(rows, first), first)
    return 0


if __name__ == "__main__":
    cli.run(main)
