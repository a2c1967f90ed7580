"""Writer of flight code: a folder of C99 with its build, test vectors and a page of how to use it."""

from __future__ import annotations

import copy
from importlib.resources import files
from pathlib import Path

from satid_gym.files import write_text
from satid_gym.flightcode.core_source import CoreSource
from satid_gym.flightcode.policy_files import template
from satid_gym.flightcode.policy_source import policy_source
from satid_gym.flightcode.vectors import expected, flight
from satid_gym.onboard.pilot import Pilot

_SAME_FOR_ALL = ("satid_math.h", "satid_pilot.h", "satid_pilot.c", "check.c", "Makefile")
_GENERATED = {"corners.h", "network.h", "script.h"}
_OWN = {file.name for file in files("satid_gym.flightcode").joinpath("c").iterdir()} | _GENERATED
_DECISIONS_MAX = 60  # of the test vectors' flight


def write(output: Path, pilot: Pilot) -> list[str]:
    """Write a pilot as C99; equal pilots give equal bytes.

    Args:
        output: folder; it is made if missing. Files of another pilot's policy that are there go.
        pilot: its data sheet, scenario, filter, policy and patience are what the code has; its seed is that of the test
            vectors' flight.

    Returns:
        Names of the files.

    Raises:
        ValueError: the policy has no C.
    """
    pilot = copy.deepcopy(pilot)  # one that is flying flies on
    found = texts(pilot)
    decisions = min(_DECISIONS_MAX, pilot.problem.scenario.decisions)
    found["vectors.csv"] = expected(pilot, flight(pilot, decisions))
    found["README.md"] = _page(pilot, decisions)
    for stale in _OWN - set(found):  # of another policy that was written there
        (Path(output) / stale).unlink(missing_ok=True)
    for name, text in sorted(found.items()):
        write_text(Path(output) / name, text)
    return sorted(found)


def texts(pilot: Pilot, counting: bool = False) -> dict[str, str]:
    """Sources of a pilot in C by name; counting: those whose operations are counted.

    Raises:
        ValueError: its policy has no C.
    """
    policy = policy_source(pilot)
    core = CoreSource(pilot, policy, counting)
    own = {"satid_core.h": core.header, "satid_core.c": core.source}
    return own | policy.texts() | {name: template(name) for name in _SAME_FOR_ALL}


def _page(pilot: Pilot, decisions: int) -> str:
    world, satellite = pilot.problem.scenario, pilot.mission.satellite
    return template("README.md").format(
        satellite=satellite.name,
        policy=pilot.policy.name,
        scenario=world.name,
        control=pilot.problem.control,
        sample=f"{world.sample_period:g}",
        decision=f"{world.decision_period:g}",
        horizon=f"{world.horizon:g}",
        patience=f"{pilot.patience:g}",
        wheels=satellite.wheels.count,
        seed=pilot.seed,
        seconds=f"{decisions * world.decision_period:g}",
    )
