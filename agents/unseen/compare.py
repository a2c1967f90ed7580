"""Comparison on unseen satellites: `python -m agents.unseen.compare`.

Flies policies on satellites drawn with seeds that neither training nor tuning used, of 3 to 8 wheels and any size,
with each inertia law, by body rates and with the full tensor. Prints, policy by policy, its errors over those of the
first one (median, 95th percentile over satellites), and on how many satellites it is inside the envelope. The planner
is slow and flies fewer episodes; a ratio is of the episodes that both have flown. The file is written after every
satellite, and the same command goes on after a stop.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.unseen.flights import LIMITS, Row, by_satellite, episodes_of, flown, inside, policy_of, ratios
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

TUNED = Path("docs/results/unseen_tuned.json")


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """Settings of the comparison."""

    policies: tuple[str, ...] = ("rigid_tour", "mpc", "rate_square", "corner_tour", "universal")
    """Learned policies by name or path, and baselines that were tuned; the first is the one that others are set
    against."""
    scenario: str = "default"
    """Scenario to fly in: default or flex."""
    satellites: int = 200
    """Satellites, drawn."""
    wheels: tuple[int, int] = SatelliteRanges().wheels
    """Least and largest number of their wheels. Each number is compiled by itself, which takes a minute or two."""
    episodes: int = 4
    """Episodes with each inertia law."""
    planned: int = 1
    """Episodes of a planner with each inertia law."""
    split: Split = "test"
    """Seeds of satellites and episodes: test, or validation to choose by."""
    tuned: Path = TUNED
    """Settings of baselines, of `python -m agents.unseen.tune`."""
    again: bool = False
    """Fly again what the file has."""
    output: Path = Path("results/unseen.json")
    """File to write; what it holds of the same comparison is not flown again."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a number is out of range, a split or policy is unknown, or the baselines were tuned elsewhere.
        """
        for name in ("satellites", "episodes", "planned"):
            check_integer(name, getattr(self, name))
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
        found = {policy.name: policy for policy in (policy_of(name, chosen) for name in self.policies)}
        if len(found) < len(self.policies):
            raise ValueError(f"policies must have different names, got {self.policies}: give one another, NAME=PATH")
        return found

    def chosen(self) -> dict[str, dict[str, Any]]:
        """Settings of the baselines that were tuned.

        Raises:
            ValueError: they were tuned in another scenario.
            DamagedFileError: the file holds none.
        """
        command = f"python -m agents.unseen.tune --scenario {self.scenario}"
        held = read_json(self.tuned, f"run {command}", keys=("settings", "chosen"))
        flown_in = held["settings"].get("scenario", "default")  # older files have none
        if flown_in != self.scenario:
            raise ValueError(f"{self.tuned} was tuned in scenario {flown_in}: give --tuned a file of {command}")
        return dict(held["chosen"])

    def identities(self) -> dict[str, Any]:
        """What decides the flights of each policy: settings of a baseline that was tuned, else `digest`."""
        chosen, entrants = self.chosen(), self.entrants()
        return {p.name: chosen.get(text) or digest(p) for text, p in zip(self.policies, entrants.values(), strict=True)}


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
        entry["nees"] = float(np.mean(list(by_satellite(rows, name, "nees").values())))
        found.append(entry)
    return found


def show(entries: list[dict[str, Any]], first: str) -> None:
    """Print a line a policy."""
    print(
        f"{'':14s} satellites  mean error, %  {first} over it: median, 95th  final: median, 95th  "
        "inside, unsaturated, all limits"
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
    first = next(iter(policies))
    done = {(row["satellite"], row["policy"]) for row in rows}
    with cli.on_interrupt(cells.GOES_ON):
        for i, satellite in enumerate(tqdm(settings.drawn(), desc="unseen", unit="satellite")):
            missing = [policy for policy in policies.values() if (satellite.name, policy.name) not in done]
            for policy in missing:
                count = episodes_of(policy.name, settings.episodes, settings.planned)
                rows += [
                    flown(policy, settings.scenario, satellite, inertia, seeds(settings.split, count, (i + 1) * 1000))
                    for inertia in INERTIA_MODES
                ]
            if missing:
                write_json(settings.output, {**head, "summary": summary(rows, first), "rows": rows})
    show(summary(rows, first), first)
    return 0


if __name__ == "__main__":
    cli.run(main)
