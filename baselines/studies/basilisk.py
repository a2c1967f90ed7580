"""Flights on Basilisk's truth next to the environment's own: `python -m baselines.studies.basilisk`.

Flies shipped policies and baselines on both truths, in the same episodes with the same noise, and prints final error,
NEES and share of the time outside the rate limits of each. Each cell is in the file as soon as it is flown: stopped,
the same command goes on. It needs `pip install ".[basilisk]"`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cells, cli
from baselines.command.provenance import result_head
from baselines.studies.worlds.catalogue import TILTED_PYRAMIDS, WORLDS, World
from baselines.studies.worlds.policies import policy_for
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.evaluation import fly, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.policies import find, make_baseline, names
from satid_gym.policies.learned.shipped import rate_names
from satid_gym.policy import Policy, observation_settings, only_mission
from satid_gym.problem import problem
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.truth import Truth

SCORES = ("final_error", "nees", "outside_fraction", "terminated")
_SATELLITE = "microsat"


@dataclass(frozen=True, kw_only=True)
class Row:
    """World that both truths have, and what Basilisk has in addition.

    Attributes:
        world: of the environment; of its satellites the microsat flies.
        step: s, of Basilisk; short where it must resolve friction at rest, or the turns of an unbalanced wheel.
        imbalance: whether Basilisk's wheels are unbalanced; the environment's never are.
    """

    world: World
    step: float = 0.02
    imbalance: bool = False


ROWS: Mapping[str, Row] = {
    "rigid": Row(world=WORLDS["as nominal"]),
    "four skewed wheels, full tensor": Row(world=TILTED_PYRAMIDS),
    "friction 10 of 100 mN m": Row(world=WORLDS["friction 10 of 100 mN m"], step=0.005),
    "imbalance of the wheels": Row(world=WORLDS["as nominal"], step=0.001, imbalance=True),
    "panels 2 %, 0.35 Hz": Row(world=WORLDS["panels 2 %, 0.35 Hz"]),
    "slosh 3 %, 0.05 Hz": Row(world=WORLDS["slosh 3 %, 0.05 Hz"]),
    "wheel axes 5 mrad": Row(world=WORLDS["wheel axes 5 mrad"]),
    "gyro bias 1e-4 rad/s": Row(world=WORLDS["gyro bias 1e-4 rad/s"]),
    "gyro scale 1 %": Row(world=WORLDS["gyro scale 1 %"]),
    "all small errors": Row(world=WORLDS["all small errors"]),
    "star tracker, gyro bias 1e-4 rad/s": Row(world=WORLDS["tracker, bias 1e-4 rad/s"]),
    "star tracker, panels 10 %, 0.35 Hz, gyro bias 1e-4 rad/s": Row(
        world=WORLDS["tracker, panels 10 %, 0.35 Hz, bias 1e-4 rad/s"]
    ),
}
"""What is flown, by name."""


@dataclass(frozen=True, kw_only=True)
class BasiliskStudy:
    """Settings of the study."""

    rows: tuple[str, ...] = tuple(ROWS)
    """Worlds to fly in."""
    policies: tuple[str, ...] = ("generalist", "ppo", "rate_square", "shaped_square", "sawtooth")
    """Shipped policies and baselines; of the paper's eight profiles sawtooth is the best within the envelope here."""
    episodes: int = 20
    """Episodes of a cell, validation seeds."""
    step: float | None = None
    """Basilisk's integration step for every row, s; None: the row's own."""
    again: bool = False
    """Fly again what the file has."""
    output: Path = Path("results/basilisk.json")
    """File to write; what it holds of the same study is not flown again."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or a number is out of range.
        """
        check_names("row", self.rows, ROWS)
        check_integer("episodes", self.episodes)
        if self.step is not None:
            check_number("step", self.step, strict=True)
        for name in self.policies:
            _policy(name, SATELLITES[_SATELLITE], Scenario())


def _satellite(world: World) -> Satellite:
    own = {satellite.name: satellite for satellite in world.satellites} or SATELLITES
    return own[_SATELLITE]


def _policy(name: str, satellite: Satellite, scenario: Scenario) -> Policy:
    if name in (*names(), *rate_names()):
        return find(name)
    return make_baseline(name, satellite.name) if name == "shaped_square" else policy_for(name, satellite, scenario)


def _truth(row: Row, step: float | None) -> Callable[[], Truth]:
    """Maker of Basilisk's truth for a row, with a step of its own or this one.

    Raises:
        UserError: Basilisk is not installed.
    """
    try:
        from satid_gym.basilisk import BasiliskTruth, Imbalance
    except ModuleNotFoundError as error:
        raise cli.UserError(f'{error}: pip install ".[basilisk]", or make test-basilisk') from error
    return partial(BasiliskTruth, step=step or row.step, imbalance=Imbalance() if row.imbalance else None)


def _flies(policy: Policy, satellite: Satellite, scenario: Scenario, control: str) -> bool:
    """Whether a policy takes the observations of a world: learned ones take those of three wheels and nine states."""
    try:
        posed = problem(satellite, "static", scenario, control=control, **observation_settings(policy))
        policy.reset(only_mission(posed), [0])
    except ValueError:
        return False
    return True


def cell(study: BasiliskStudy, row: str, name: str) -> dict[str, Any]:
    """Scores of one policy in one world, mean over episodes, on both truths; None where it cannot fly there."""
    truth, world, satellite = _truth(ROWS[row], study.step), ROWS[row].world, _satellite(ROWS[row].world)
    scenario = Scenario(**world.scenario)
    policy = _policy(name, satellite, scenario)
    control = "rate" if observation_settings(policy).get("observation") == "body" else "torque"
    found: dict[str, Any] = {"row": row, "policy": name, "own": None, "basilisk": None, "flights_apart": None}
    if not _flies(policy, satellite, scenario, control):
        return found
    chosen = seeds("validation", study.episodes)
    flown = partial(
        fly, policy, satellite=satellite, inertia="static", seeds=chosen, scenario=scenario, control=control
    )
    own, theirs = flown().scores(), flown(truth=truth).scores()
    for where, scores in (("own", own), ("basilisk", theirs)):
        found[where] = {score: float(scores[score].mean()) for score in SCORES}
    apart = np.abs(theirs["final_error"] / own["final_error"] - 1.0)
    return {**found, "flights_apart": {"median": float(np.median(apart)), "largest": float(apart.max())}}


def show(rows: list[dict[str, Any]]) -> None:
    """Print one line for each row and policy: final error, NEES and time outside on both truths."""
    heads = "".join(f"{name:>24s}" for name in ("final error, %", "NEES", "outside, %"))
    print(f"{'row':32s} {'policy':14s}{heads}   on Basilisk / on the environment's own truth")
    for one in rows:
        line = f"{one['row']:32s} {one['policy']:14s}"
        if one["own"] is None:
            print(line + "    does not take these observations")
            continue
        for score, factor, pattern in (
            ("final_error", 100, ".5f"),
            ("nees", 1, ".3f"),
            ("outside_fraction", 100, ".2f"),
        ):
            pair = (f"{factor * one[truth][score]:{pattern}}" for truth in ("basilisk", "own"))
            line += f"{' / '.join(pair):>24s}"
        print(line)


@cli.on_interrupt(cells.GOES_ON)
def main(study: BasiliskStudy) -> int:
    """Fly the study of the command line; returns the exit code."""
    check_writable(study.output.parent)
    used = seeds("validation", study.episodes)
    packages = ("satid-gym", "numpy", "bsk")
    head = result_head(
        "baselines.studies.basilisk", study, split="validation", seeds=used, packages=packages, output=study.output
    )
    with cli.user_errors():
        old = cells.kept(study.output, head, "cells", again=study.again)
    wanted = [(row, name) for row in study.rows for name in study.policies]
    done = {(one["row"], one["policy"]): one for one in old}
    missing = [own for own in wanted if own not in done]
    for own in tqdm(missing, desc="basilisk", unit="cell", initial=len(done), total=len(wanted)):
        done[own] = cell(study, *own)
        write_json(study.output, {**head, "cells": list(done.values())})
    show([done[own] for own in wanted])
    return 0


if __name__ == "__main__":
    cli.run(main)
