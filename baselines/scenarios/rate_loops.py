"""Rate loops in the world as flown: `python -m baselines.scenarios.rate_loops`.

Flies `rate_square` through both loops, the deadbeat law that a policy runs once a decision (control "torque") and the
tracking loop of the environment (control "rate"), and prints the share of the time outside the envelope, the final
error and the mean deflection side by side.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.studies.worlds.catalogue import TILTED_PYRAMIDS, WORLDS, World
from baselines.studies.worlds.policies import policy_for
from baselines.studies.worlds.satellites import PYRAMIDS
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.evaluation import fly, seeds
from satid_gym.faults import Faults
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES, MASS_MODES
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.problem import CONTROLS
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES, Satellite
from satid_gym.scenario import Scenario

_FAILS = Faults(wheel_loss=1.0, wheel_loss_size=(1.0, 1.0))
_OWN: Mapping[str, World] = {
    "full tensor": World(scenario={"tilt_std": 0.15}),
    "inertia off by 30 %": World(scenario={"inertia_std": 0.3}),
    "pyramid of four": World(satellites=PYRAMIDS),
    "pyramid, full tensor": TILTED_PYRAMIDS,
    "commands 1 sample late": World(scenario={"faults": Faults(torque_delay=(1, 1))}),
    "commands 3 samples late": World(scenario={"faults": Faults(torque_delay=(3, 3))}),
    "a wheel lost": World(scenario={"faults": Faults(wheel_loss=1.0)}),
    "pyramid, a wheel lost": World(scenario={"faults": Faults(wheel_loss=1.0)}, satellites=PYRAMIDS),
    "a wheel fails": World(scenario={"faults": _FAILS}),
    "pyramid, a wheel fails": World(scenario={"faults": _FAILS}, satellites=PYRAMIDS),
}
_FLEXIBLE = (
    "panels 2 %, 0.35 Hz",
    "panels 10 %, 0.1 Hz",
    "panels 10 %, 0.35 Hz",
    "panels 10 %, 1 Hz",
    "panels 25 %, 0.35 Hz",
    "slosh 3 %, 0.05 Hz",
)
_SLOPE = 0.3  # of 0.3, 0.35 and 0.4 the largest that kept panels of 0.1 Hz inside on ten episodes, decision by decision
_STUDIED = (
    "as nominal",
    "all small errors",
    "gyro noise 1e-3 rad/s",
    "friction 1 of 10 mN m",
    "friction 10 of 100 mN m",
    "sample 1 s",
    "sample 0.02 s",
    "tachometers 1 late",
    "64 pulses 0.9(1) late",
    *_FLEXIBLE,
)
_EASED: Mapping[str, World] = {
    f"{name}, slope {_SLOPE:g}": World(scenario={"reference_slope": _SLOPE}, satellites=WORLDS[name].satellites)
    for name in _FLEXIBLE
}
EFFECTS: Mapping[str, World] = {**{name: WORLDS[name] for name in _STUDIED}, **_EASED, **_OWN}
"""Worlds that are flown, by name."""


@dataclass(frozen=True, kw_only=True)
class RateLoopStudy:
    """Settings of the study."""

    worlds: tuple[str, ...] = tuple(EFFECTS)
    """Worlds to fly in."""
    controls: tuple[str, ...] = CONTROLS
    """Loops: torque (deadbeat, once a decision) and rate (tracking, every sample)."""
    margin: float = 3.5
    """Distance of the tracked rates from their limit, in standard deviations."""
    bandwidth: float = Scenario().rate_bandwidth
    """Bandwidth of the tracking loop, rad/s."""
    inertia: str = "static"
    """Inertia mode."""
    episodes: int = 20
    """Episodes of a cell, validation seeds."""
    output: Path = Path("results/rate_loops.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or a number is out of range.
        """
        check_names("world", self.worlds, EFFECTS)
        check_names("control", self.controls, CONTROLS)
        check_names("inertia mode", [self.inertia], (*INERTIA_MODES, *MASS_MODES))
        check_number("margin", self.margin)
        check_number("bandwidth", self.bandwidth, strict=True)
        check_integer("episodes", self.episodes)


def cell(study: RateLoopStudy, world: str, satellite: Satellite, control: str) -> dict[str, Any]:
    """Scores of one cell, mean over episodes."""
    scenario = Scenario(rate_bandwidth=study.bandwidth, **EFFECTS[world].scenario)
    policy = policy_for("rate_square", satellite, scenario)
    assert isinstance(policy, RateSquarePolicy)
    if control == "rate":
        policy = RateSquarePolicy(policy.period, study.margin)
    flight = fly(
        policy,
        satellite=satellite,
        inertia=study.inertia,
        seeds=seeds("validation", study.episodes),
        scenario=scenario,
        control=control,
    )
    names = ("final_error", "outside_fraction", "nees", "saturated_fraction", "terminated")
    scores = {name: float(values.mean()) for name, values in flight.scores().items() if name in names}
    return {"world": world, "satellite": satellite.name, "control": control, **scores}


def show(rows: list[dict[str, Any]]) -> None:
    """Print one line for each world: by loop, worst time outside and range of final errors over its satellites."""
    controls = tuple(dict.fromkeys(row["control"] for row in rows))
    print(f"{'world':26s}" + "".join(f"{name + ': outside, %':>20s} {'final error, %':>18s}" for name in controls))
    for world in dict.fromkeys(row["world"] for row in rows):
        line = f"{world:26s}"
        for control in controls:
            own = [row for row in rows if (row["world"], row["control"]) == (world, control)]
            errors = [100.0 * row["final_error"] for row in own]
            spread = f"{min(errors):.3f} to {max(errors):.3f}" if len(errors) > 1 else f"{errors[0]:.3f}"
            line += f"{100.0 * max(row['outside_fraction'] for row in own):20.2f} {spread:>18s}"
        print(line)


@cli.on_interrupt("no file is written")
def main(study: RateLoopStudy) -> int:
    """Fly the study of the command line; returns the exit code."""
    check_writable(study.output.parent)
    benchmark = [SATELLITES[name] for name in BENCHMARK_SATELLITES]
    chosen = [
        (world, satellite, control)
        for world in study.worlds
        for satellite in EFFECTS[world].satellites or benchmark
        for control in study.controls
    ]
    rows = [cell(study, *own) for own in tqdm(chosen, desc="rate loops", unit="cell")]
    head = result_head(
        "baselines.scenarios.rate_loops", study, split="validation", seeds=seeds("validation", study.episodes)
    )
    write_json(study.output, {**head, "cells": rows})
    show(rows)
    return 0


if __name__ == "__main__":
    cli.run(main)
