"""Consistency of a filter that is told too little: `python -m baselines.scenarios.unmodelled`.

Flies satellites with panels, slosh, a gyro bias or friction of which their filter knows nothing, and prints for each
what becomes of error and NEES without and with `inflate`, in how many episodes the innovations raise an alarm, and how
many end early. NEES is a mean over the readings of flights that have not ended; one that is not finite is an error.
In world "as nominal" nothing is left out but what every episode of the scenario has.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.studies.worlds.catalogue import WORLDS
from baselines.studies.worlds.policies import policy_for
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import Split, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES, MASS_MODES
from satid_gym.policies.registry import BASELINES
from satid_gym.policy import missions
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.vector import SatInertiaIDVectorEnv

UNTOLD = {"name": "adaptive", "calibrate": False, "flexible": False}
SETTLED = 60.0  # s


@dataclass(frozen=True, kw_only=True)
class UnmodelledStudy:
    """Settings of the study."""

    worlds: tuple[str, ...] = (
        "as nominal",
        "friction 10 of 100 mN m",
        "gyro bias 2e-5 rad/s",
        "gyro bias 1e-4 rad/s",
        "gyro bias 1e-3 rad/s",
        "gyro scale 1 %",
        "rotor inertia 1 %",
        "panels 2 %, 0.35 Hz",
        "panels 10 %, 0.1 Hz",
        "panels 10 %, 0.35 Hz",
        "panels 10 %, 1 Hz",
        "slosh 3 %, 0.05 Hz",
    )
    """Worlds to fly in, of which the filter is not told."""
    policies: tuple[str, ...] = ("rate_square", "multi_step", "sine")
    """Baselines to fly."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    inertias: tuple[str, ...] = INERTIA_MODES
    """Inertia modes."""
    episodes: int = 20
    """Episodes of a cell."""
    split: Split = "validation"
    """Split of their seeds."""
    output: Path = Path("results/unmodelled.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown, a world has none of the satellites, or the number of episodes is not
                positive.
        """
        check_names("policy", self.policies, list(BASELINES))
        check_names("world", self.worlds, WORLDS)
        own = {satellite.name for world in self.worlds for satellite in WORLDS[world].satellites}
        check_names("satellite", self.satellites, {*SATELLITES, *own})
        check_names("inertia mode", self.inertias, (*INERTIA_MODES, *MASS_MODES))
        check_integer("episodes", self.episodes)
        seeds(self.split, self.episodes)
        for world in self.worlds:
            if not self.satellites_of(world):
                names = ", ".join(satellite.name for satellite in WORLDS[world].satellites)
                raise ValueError(f"world {world!r} has satellites of its own and none of the study's: add {names}")

    def satellites_of(self, world: str) -> list[Satellite]:
        """Satellites of the study as a world has them."""
        own = {satellite.name: satellite for satellite in WORLDS[world].satellites} or SATELLITES
        return [own[name] for name in self.satellites if name in own]


def cell(study: UnmodelledStudy, world: str, policy: str, satellite: Satellite, inertia: str) -> dict[str, Any]:
    """Scores of one cell by (`inflate` off, on): lists of two means over episodes, and of two counts of those ended.

    Raises:
        ValueError: see `mean_nees`.
    """
    scenario = Scenario(**WORLDS[world].scenario)
    pilot, chosen = policy_for(policy, satellite, scenario), seeds(study.split, study.episodes)
    found: dict[str, Any] = {"world": world, "satellite": satellite.name, "inertia": inertia, "policy": policy}
    for inflate in (False, True):
        env = SatInertiaIDVectorEnv(study.episodes, satellite, inertia, scenario, {**UNTOLD, "inflate": inflate})
        (mission,) = missions(env.problem)
        pilot.reset(mission, chosen)
        observation, info = env.reset(seed=chosen)
        alive, nees, flown = np.ones(study.episodes, bool), [], []
        error, alarmed = info["relative_error"].copy(), np.zeros(study.episodes, bool)
        for _ in range(scenario.decisions):
            observation, _, terminated, _, info = env.step(pilot(observation))
            error[alive], alarmed = info["relative_error"][alive], alarmed | (alive & info["unmodelled"])
            nees.append(info["nees"].copy())
            flown.append(alive.copy())
            alive &= ~terminated
        env.close()
        late = round(SETTLED / scenario.decision_period)
        scores = {
            "nees": mean_nees(np.array(nees), np.array(flown)),
            "nees_settled": mean_nees(np.array(nees[late:]), np.array(flown[late:])),
            "final_error": float(error.mean()),
            "alarmed": float(alarmed.mean()),
            "ended": int((~alive).sum()),
        }
        for name, value in scores.items():
            found.setdefault(name, []).append(value)
    return found


def mean_nees(nees: np.ndarray, flown: np.ndarray) -> float:
    """Mean of NEES (T, N) where a flight goes on, `flown` (T, N).

    Raises:
        ValueError: no flight goes on, or NEES is not finite where one does.
    """
    own = nees[flown]
    if not own.size or not np.isfinite(own).all():
        broken = np.flatnonzero((flown & ~np.isfinite(nees)).any(axis=0))
        raise ValueError(f"NEES of {own.size} readings, not finite in episodes {broken.tolist()}")
    return float(own.mean())


def show(rows: list[dict[str, Any]]) -> None:
    """Print one line for each world and policy: means over satellites and inertia modes, without -> with `inflate`."""
    head = f"{'NEES':>18s} {'from 60 s on':>18s} {'final error, %':>20s} {'alarmed':>14s} {'ended':>10s}"
    print(f"{'world':24s} {'policy':12s}{head}")
    for world, policy in dict.fromkeys((row["world"], row["policy"]) for row in rows):
        own = [row for row in rows if (row["world"], row["policy"]) == (world, policy)]
        mean = {name: np.mean([row[name] for row in own], axis=0) for name in own[0] if name not in row_keys(own[0])}
        nees, late = (f"{mean[name][0]:8.2f} -> {mean[name][1]:5.2f}" for name in ("nees", "nees_settled"))
        error = f"{100 * mean['final_error'][0]:8.4f} -> {100 * mean['final_error'][1]:7.4f}"
        alarm = f"{mean['alarmed'][0]:5.0%} -> {mean['alarmed'][1]:5.0%}"
        ended = " -> ".join(str(count) for count in np.sum([row["ended"] for row in own], axis=0))
        print(f"{world:24s} {policy:12s}{nees:>18s} {late:>18s} {error:>20s} {alarm:>14s} {ended:>10s}")


def row_keys(row: dict[str, Any]) -> set[str]:
    """Names of what says which cell a row is."""
    return {name for name, value in row.items() if isinstance(value, str)}


@cli.on_interrupt("no file is written")
def main(study: UnmodelledStudy) -> int:
    """Fly the study of the command line; returns the exit code."""
    check_writable(study.output.parent)
    cells = [
        (world, policy, satellite, inertia)
        for world in study.worlds
        for policy in study.policies
        for satellite in study.satellites_of(world)
        for inertia in study.inertias
    ]
    rows = [cell(study, *own) for own in tqdm(cells, desc="unmodelled", unit="cell")]
    used = seeds(study.split, study.episodes)
    head = result_head("baselines.scenarios.unmodelled", study, split=study.split, seeds=used)
    write_json(study.output, {**head, "cells": rows})
    show(rows)
    return 0


if __name__ == "__main__":
    cli.run(main)
