"""Consistency of the filter with sensors and wheels off nominal: `python -m baselines.studies.consistency`.

Flies policies in worlds whose data sheet tells of an error, or where little excites the body, and prints final error
and NEES: the mean normalised estimation error squared per degree of freedom, over episodes and time, of which a
consistent filter has about 1. With --no-calibrate the same flights are estimated as if everything were nominal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import fly, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.registry import BASELINES, make_baseline
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES
from satid_gym.scenario import Scenario
from satid_gym.tolerances import Tolerances

WORLDS: Mapping[str, Mapping[str, Any]] = {
    "as nominal": {},
    "gyro bias 2e-5 rad/s": {"tolerances": Tolerances(gyro_bias=2e-5)},
    "gyro bias 1e-4 rad/s": {"tolerances": Tolerances(gyro_bias=1e-4)},
    "gyro bias 1e-3 rad/s": {"tolerances": Tolerances(gyro_bias=1e-3)},
    "gyro scale 0.1 %": {"tolerances": Tolerances(gyro_scale=1e-3)},
    "gyro scale 1 %": {"tolerances": Tolerances(gyro_scale=1e-2)},
    "gyro alignment 3 mrad": {"tolerances": Tolerances(gyro_alignment=3e-3)},
    "rotor inertia 0.1 %": {"tolerances": Tolerances(wheel_inertia=1e-3)},
    "rotor inertia 1 %": {"tolerances": Tolerances(wheel_inertia=1e-2)},
    "wheel axes 1 mrad": {"tolerances": Tolerances(wheel_alignment=1e-3)},
    "wheel axes 5 mrad": {"tolerances": Tolerances(wheel_alignment=5e-3)},
    "all small errors": {
        "tolerances": Tolerances(
            gyro_bias=1e-4, gyro_scale=1e-3, gyro_alignment=1e-3, wheel_inertia=1e-3, wheel_alignment=1e-3
        )
    },
    "no torque noise": {"torque_noise": 0.0},
    "gyro noise 1e-3 rad/s": {"gyro_noise_std": 1e-3},
}
"""Worlds that are flown, by name: what differs from scenario "default"."""


@dataclass(frozen=True, kw_only=True)
class ConsistencyStudy:
    """Settings of the study."""

    policies: tuple[str, ...] = ("rate_square", "multi_step", "sine", "one_step", "zero")
    """Baselines to fly."""
    worlds: tuple[str, ...] = tuple(WORLDS)
    """Worlds to fly in."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    inertias: tuple[str, ...] = INERTIA_MODES
    """Inertia modes."""
    tilt: float = 0.0
    """Std of the rotation of the true principal axes, rad; above 0 the filter estimates the full tensor."""
    estimator: str = "adaptive"
    """Filter: adaptive or momentum."""
    calibrate: bool = True
    """Whether the filter estimates the errors too."""
    rate_coordinates: bool = False
    """Whether its updates are made in errors of the rate also where it estimates no errors."""
    episodes: int = 100
    """Episodes of a cell, validation seeds."""
    output: Path = Path("results/consistency.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown, the number of episodes is not positive, or tilt is negative.
        """
        check_names("policy", self.policies, list(BASELINES))
        check_names("world", self.worlds, WORLDS)
        check_names("satellite", self.satellites, SATELLITES)
        check_names("inertia mode", self.inertias, INERTIA_MODES)
        check_names("estimator", (self.estimator,), ["adaptive", "momentum"])
        check_integer("episodes", self.episodes)
        self.world("as nominal")

    def world(self, name: str) -> Scenario:
        """Scenario of a world."""
        return Scenario(tilt_std=self.tilt, **WORLDS[name])


def cell(study: ConsistencyStudy, world: str, satellite: str, inertia: str, policy: str) -> dict[str, Any]:
    """Scores of one cell: mean final error, mean NEES and its 95 % quantile over episodes, time outside."""
    scores = fly(
        make_baseline(policy, satellite),
        satellite=satellite,
        inertia=inertia,
        seeds=seeds("validation", study.episodes),
        scenario=study.world(world),
        estimator={
            "name": study.estimator,
            "calibrate": study.calibrate,
            "rate_coordinates": study.rate_coordinates,
        },
    ).scores()
    return {
        "world": world,
        "satellite": satellite,
        "inertia": inertia,
        "policy": policy,
        "final_error": float(scores["final_error"].mean()),
        "nees": float(scores["nees"].mean()),
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


@cli.on_interrupt("no file is written")
def main(study: ConsistencyStudy) -> int:
    """Fly the study of the command line; returns the exit code."""
    check_writable(study.output.parent)
    cells = [
        (world, satellite, inertia, policy)
        for world in study.worlds
        for policy in study.policies
        for satellite in study.satellites
        for inertia in study.inertias
    ]
    rows = [cell(study, *own) for own in tqdm(cells, desc="consistency", unit="cell")]
    head = result_head(
        "baselines.studies.consistency", study, split="validation", seeds=seeds("validation", study.episodes)
    )
    write_json(study.output, {**head, "cells": rows})
    show(rows)
    return 0


if __name__ == "__main__":
    cli.run(main)
