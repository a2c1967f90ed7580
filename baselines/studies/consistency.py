"""Consistency of the filter with sensors and wheels off nominal: `python -m baselines.studies.consistency`.

Flies policies in worlds whose data sheet tells of an error or of friction, where little excites the body, and in others
of sampling, size and horizon, and prints final error and NEES: the mean normalised estimation error squared per degree
of freedom, over episodes and time, of which a consistent filter has about 1. With --no-calibrate the same flights are
estimated as if everything were nominal.

Each cell is in the file as soon as it is flown: stopped, the same command of the same revision goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cells, cli
from baselines.command.provenance import result_head
from baselines.studies.worlds.catalogue import WORLDS
from baselines.studies.worlds.policies import policy_for
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import FIRST_SEED, Split, fly, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES, MASS_MODES
from satid_gym.policies.registry import BASELINES
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES, Satellite
from satid_gym.scenario import Scenario

_LISTS = ("policies", "worlds", "satellites", "inertias")

Place = tuple[str, str, str, str]  # world, policy, satellite, inertia mode


@dataclass(frozen=True, kw_only=True)
class ConsistencyStudy:
    """Settings of the study."""

    policies: tuple[str, ...] = ("rate_square", "multi_step", "sine", "one_step", "zero")
    """Baselines to fly."""
    worlds: tuple[str, ...] = tuple(WORLDS)
    """Worlds to fly in."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly, in worlds that have none of their own."""
    inertias: tuple[str, ...] = INERTIA_MODES
    """Inertia modes."""
    tilt: float = 0.0
    """Std of the rotation of the true principal axes, rad; above 0 the filter estimates the full tensor."""
    estimator: str = "adaptive"
    """Filter: adaptive or momentum."""
    calibrate: bool = True
    """Whether the filter estimates the errors too."""
    flexible: bool = True
    """Whether the filter estimates the modes of panels and slosh masses."""
    announced: bool = True
    """Whether the filter is told when a deployment or a release is commanded."""
    tuned: bool = True
    """Whether the filter has the settings that a world asks for; else the defaults."""
    rate_coordinates: bool | None = None
    """Whether updates are in errors of the rate where it estimates no errors; None: where the motors shake little."""
    episodes: int = 100
    """Episodes of a cell."""
    split: Split = "validation"
    """Seeds: validation, or test for a last look at what was chosen by validation."""
    merge: bool = False
    """Whether cells of other worlds, policies, satellites, modes and revisions stay in the file."""
    again: bool = False
    """Fly again what the file has."""
    output: Path = Path("results/consistency.json")
    """File to write; what it holds of the same study is not flown again."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown, the number of episodes is not positive, or tilt is negative.
        """
        check_names("policy", self.policies, list(BASELINES))
        check_names("world", self.worlds, WORLDS)
        check_names("satellite", self.satellites, SATELLITES)
        check_names("inertia mode", self.inertias, (*INERTIA_MODES, *MASS_MODES))
        check_names("estimator", (self.estimator,), ["adaptive", "momentum"])
        check_integer("episodes", self.episodes)
        check_names("split of seeds", [self.split], FIRST_SEED)
        self.world("as nominal")

    def world(self, name: str) -> Scenario:
        """Scenario of a world."""
        return Scenario(tilt_std=self.tilt, **WORLDS[name].scenario)

    def satellites_of(self, world: str) -> tuple[Satellite, ...]:
        """Satellites that fly in a world."""
        return WORLDS[world].satellites or tuple(SATELLITES[name] for name in self.satellites)


def cell(study: ConsistencyStudy, world: str, policy: str, satellite: Satellite, inertia: str) -> dict[str, Any]:
    """Scores of one cell: mean final error, mean NEES, its median and its 95 % quantile over episodes, time outside."""
    scenario, own = study.world(world), WORLDS[world]
    scores = fly(
        policy_for(policy, satellite, scenario, own.control),
        satellite=satellite,
        inertia=inertia,
        seeds=seeds(study.split, study.episodes),
        scenario=scenario,
        control=own.control,
        estimator={
            "name": study.estimator,
            "calibrate": study.calibrate,
            "flexible": study.flexible,
            "rate_coordinates": study.rate_coordinates,
            "announced": study.announced,
            **(own.estimator if study.tuned else {}),
        },
    ).scores()
    return {
        "world": world,
        "satellite": satellite.name,
        "inertia": inertia,
        "policy": policy,
        "final_error": float(scores["final_error"].mean()),
        "nees": float(scores["nees"].mean()),
        "nees_median": float(np.median(scores["nees"])),
        "nees_worst": float(np.quantile(scores["nees"], 0.95)),
        "outside": float(scores["outside_fraction"].mean()),
    }


def show(rows: list[dict[str, Any]]) -> None:
    """Print one line for each world and policy: over satellites and inertia modes, range of error and of NEES."""
    print(f"{'world':24s} {'policy':14s} {'final error, %':>20s} {'NEES':>16s}")
    for world, policy in dict.fromkeys((row["world"], row["policy"]) for row in rows):
        own = [row for row in rows if (row["world"], row["policy"]) == (world, policy)]
        errors, nees = ([row[name] for row in own] for name in ("final_error", "nees"))
        spread = f"{100 * min(errors):.4f} to {100 * max(errors):.4f}"
        print(f"{world:24s} {policy:14s} {spread:>20s} {f'{min(nees):.2f} to {max(nees):.2f}':>16s}")


@cli.on_interrupt(cells.GOES_ON)
def main(study: ConsistencyStudy) -> int:
    """Fly the study of the command line; returns the exit code."""
    check_writable(study.output.parent)
    chosen = {
        (world, policy, satellite.name, inertia): satellite
        for world in study.worlds
        for policy in study.policies
        for satellite in study.satellites_of(world)
        for inertia in study.inertias
    }
    used = seeds(study.split, study.episodes)
    head = result_head("baselines.studies.consistency", study, split=study.split, seeds=used, output=study.output)
    with cli.user_errors():
        old = cells.kept(study.output, head, "cells", again=study.again, mixed=_LISTS if study.merge else ())
    now, lasting = head["revision"], cells.is_clean(head["revision"]) and not study.again
    rows = {(own["world"], own["policy"], own["satellite"], own["inertia"]): own for own in old}
    missing = [place for place in chosen if not (lasting and rows.get(place, {}).get("revision") == now)]
    head["settings"]["worlds"] = list(dict.fromkeys([*(own["world"] for own in old), *study.worlds]))
    for place in tqdm(missing, desc="consistency", unit="cell", initial=len(chosen) - len(missing), total=len(chosen)):
        world, policy, _, inertia = place
        rows.pop(place, None)
        rows[place] = {"revision": now, **cell(study, world, policy, chosen[place], inertia)}
        write_json(study.output, {**head, "cells": list(rows.values())})
    show([rows[place] for place in chosen])
    return 0


if __name__ == "__main__":
    cli.run(main)
