"""Four wheels and a speed to avoid: `python -m baselines.scenarios.four_wheels`. Does the choice of excitation matter?

A pyramid of four wheels with encoders and friction avoids a band about zero speed. Nothing, square waves of rate, the
paper's signals and `clear_square` fly by body rates, with the rate loop's null motion, which keeps wheels out of the
band, and without it. It is printed what the best of each kind expects with at most a share of the time in the band, and
what the best of all expects without any limit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.scenarios.flights import AnyCell, flown
from baselines.scenarios.rivals import Quieter
from baselines.studies.worlds import on_pyramid
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.evaluation import seeds
from satid_gym.faults import Faults
from satid_gym.files import check_writable, write_json
from satid_gym.friction import WheelFriction
from satid_gym.gym_api import COSTS
from satid_gym.policies.clear_square import ClearSquarePolicy
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import ZeroPolicy
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policy import Policy
from satid_gym.profiles import PROFILES
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import Scenario
from satid_gym.sensors import Sensors
from satid_gym.vector import SatInertiaIDVectorEnv

AMPLITUDES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.95)  # of the rate limit, of square waves
_COARSE = (0.05, 0.2, 0.5, 0.95)  # likewise, of the paper's signals
_PERIODS = (12.0, 24.0)  # s
_FRICTION = WheelFriction(coulomb=5e-4, static=8e-4)
_PULSES = 1024  # a revolution


HEAD = (
    "world",
    "null motion",
    "band at rest, %",
    "eight, inside, %",
    "square, inside, %",
    "clear_square, % (band)",
    "no limit, %",
)
"""Head of the summary."""


@dataclass(frozen=True, kw_only=True)
class Wheels:
    """Load of the wheels, and how many fail.

    Attributes:
        scale: of the speed limit of the satellite's wheels.
        load: first speeds over that limit.
        high: rad/s, end of the avoided band, which begins at rest.
        loss: probability that one wheel loses all of its torque between 0.2 and 0.6 of the flight.
    """

    scale: float = 1.0
    load: float = 0.2
    high: float = 10.0
    loss: float = 0.0


WORLDS: Mapping[str, Wheels] = {
    "own wheels": Wheels(),
    "own wheels, one lost in 20 %": Wheels(loss=0.2),
    "own wheels, one lost": Wheels(loss=1.0),
    "small wheels": Wheels(scale=0.3, load=0.5, high=20.0),
    "small wheels, one lost in 20 %": Wheels(scale=0.3, load=0.5, high=20.0, loss=0.2),
}
"""Worlds that are flown, by name."""


@dataclass(frozen=True, kw_only=True)
class FourWheels:
    """Settings of the study."""

    worlds: tuple[str, ...] = tuple(WORLDS)
    """Worlds to fly in."""
    satellite: str = "microsat"
    """Satellite whose wheels are arranged as a pyramid."""
    cost: float = 0.01
    """Largest cost of each kind, as a share of the time."""
    episodes: int = 16
    """Episodes of a flight, tuning seeds."""
    output: Path = Path("results/four_wheels.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or a number is out of range.
        """
        check_names("world", self.worlds, WORLDS)
        check_names("satellite", [self.satellite], SATELLITES)
        check_number("cost", self.cost, high=1.0)
        check_integer("episodes", self.episodes)


def cell_of(satellite: str, wheels: Wheels) -> AnyCell:
    """What is flown."""
    scenario = Scenario(
        name="four wheels",
        wheel_speed_scale=wheels.scale,
        wheel_speed_range=wheels.load,
        friction=_FRICTION,
        sensors=Sensors(encoder_pulses=_PULSES),
        faults=Faults(wheel_loss=wheels.loss, wheel_loss_size=(1.0, 1.0)),
    )
    pyramid = on_pyramid(SATELLITES[satellite], (0.0, wheels.high))
    return AnyCell(scenario=scenario, satellite=pyramid, inertia="static")


def shared_evenly(env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
    """Let wheels share the momentum evenly, as if they had no speed to avoid; what is observed stays."""
    env.fleet.rows.tasks["tracking"]["null"]["on"] = 0
    return observation


def excitations() -> dict[str, dict[float, Policy]]:
    """Policies by name and amplitude."""
    squares: dict[str, dict[float, Policy]] = {
        f"square, {period:g} s": {a: Quieter(RateSquarePolicy(period, 3.5), a) for a in AMPLITUDES}
        for period in _PERIODS
    }
    loud: dict[str, dict[float, Policy]] = {
        name: {a: ScriptedPolicy(name, profile, a) for a in _COARSE} for name, profile in PROFILES.items()
    }
    return {"zero": {0.0: ZeroPolicy()}, **squares, **loud, "clear_square": {1.0: ClearSquarePolicy()}}


def rows_of(study: FourWheels, world: str, null_motion: bool) -> list[dict[str, Any]]:
    """Scores of each policy and amplitude, mean over episodes."""
    cell, told = cell_of(study.satellite, WORLDS[world]), None if null_motion else shared_evenly
    rows = []
    for name, policies in excitations().items():
        for amplitude, policy in policies.items():
            flight = flown(cell, policy, seeds("tuning", study.episodes), told)
            expected = float(flight.expected.mean())
            rows.append(
                {
                    "world": world,
                    "null_motion": null_motion,
                    "policy": name,
                    "amplitude": amplitude,
                    "expected": expected if np.isfinite(expected) else None,
                    "final_error": float(flight.error.mean()),
                    "nees": float(flight.nees.mean()),
                    "costs": dict(zip(COSTS, flight.costs.mean(axis=0).tolist(), strict=True)),
                    "inside": flight.inside(study.cost),
                }
            )
    return rows


def summary(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Table: of each world, with and without null motion, time in the band at rest and the best of each kind, in %."""
    table = []
    for world, null_motion in dict.fromkeys((row["world"], row["null_motion"]) for row in rows):
        own = [row for row in rows if (row["world"], row["null_motion"]) == (world, null_motion)]
        by_name = {row["policy"]: row for row in own}
        free = [row for row in own if row["policy"] != "clear_square"]
        eight = [row for row in own if row["policy"] in PROFILES]
        squares = [row for row in own if row["policy"].startswith("square")]
        law = by_name["clear_square"]
        table.append(
            [
                world,
                "yes" if null_motion else "no",
                f"{100.0 * by_name['zero']['costs']['avoided_band']:.2f}",
                _least([row for row in eight if row["inside"]]),
                _least([row for row in squares if row["inside"]]),
                f"{_least([law])} ({100.0 * law['costs']['avoided_band']:.1f})",
                _least(free),
            ]
        )
    return table


def _least(rows: Sequence[Mapping[str, Any]]) -> str:
    """The least expected error; none where no row has one, or where episodes ended early under all."""
    own = [row for row in rows if row["expected"] is not None]
    if not own:
        return "none"
    least = min(own, key=lambda row: row["expected"])
    return f"{100.0 * least['expected']:.3f}"


def show(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print the summary."""
    for world, *figures in [list(HEAD), *summary(rows)]:
        print(f"{world:32s}" + "".join(f"{figure:>22s}" for figure in figures))


@cli.on_interrupt("no file is written")
def main(study: FourWheels) -> int:
    """Fly the study of the command line; returns the exit code."""
    check_writable(study.output.parent)
    chosen = [(world, null_motion) for world in study.worlds for null_motion in (False, True)]
    rows = [row for own in tqdm(chosen, desc="four wheels", unit="world") for row in rows_of(study, *own)]
    settings, flown_seeds = dataclasses.asdict(study), seeds("tuning", study.episodes)
    head = result_head("baselines.scenarios.four_wheels", settings, split="tuning", seeds=flown_seeds)
    write_json(study.output, {**head, "cells": rows})
    show(rows)
    return 0


if __name__ == "__main__":
    cli.run(main)
