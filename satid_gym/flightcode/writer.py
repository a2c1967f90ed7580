"""Writer of flight code: a folder of C99 with its build, test vectors and a page of how to use it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from satid_gym.config import check_integer
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.files import write_text
from satid_gym.flightcode.core_source import CoreSource
from satid_gym.flightcode.policy_source import policy_source, template
from satid_gym.flightcode.vectors import expected, flight
from satid_gym.onboard.pilot import Pilot
from satid_gym.policy import Policy
from satid_gym.resolution import SatelliteLike, ScenarioLike

_SAME_FOR_ALL = ("satid_math.h", "satid_pilot.h", "satid_pilot.c", "check.c", "Makefile")
_DECISIONS_MAX = 60  # of the test vectors' flight


def write(
    output: Path,
    satellite: SatelliteLike,
    policy: str | Policy = "generalist",
    *,
    scenario: ScenarioLike = "default",
    estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
    control: str = "torque",
    patience: float | None = None,
    seed: int = 0,
) -> list[str]:
    """Write C99 of what `Pilot` flies with these arguments, which are its own; the same ones give the same bytes.

    Args:
        output: folder; it is made if missing.
        satellite, policy, scenario, estimator, control, patience: see `Pilot`.
        seed: of the test vectors' flight, and of a policy that draws at random.

    Returns:
        Names of the files.

    Raises:
        ValueError: an argument is not valid, or the policy has no C.
    """
    seed = check_integer("seed", seed, low=0)
    pilot = Pilot(
        satellite, policy, scenario=scenario, estimator=estimator, control=control, patience=patience, seed=seed
    )
    found = texts(pilot)
    decisions = min(_DECISIONS_MAX, pilot.problem.scenario.decisions)
    found["vectors.csv"] = expected(pilot, flight(pilot, seed, decisions))
    found["README.md"] = _page(pilot, seed, decisions)
    for name, text in sorted(found.items()):
        write_text(Path(output) / name, text)
    return sorted(found)


def texts(pilot: Pilot, counting: bool = False) -> dict[str, str]:
    """Sources of a pilot in C by name; counting: those whose operations are counted.

    Raises:
        ValueError: its policy has no C.
    """
    policy = policy_source(pilot)
    core = CoreSource(pilot, policy.constants, counting)
    own = {"satid_core.h": core.header, "satid_core.c": core.source}
    return own | policy.texts() | {name: template(name) for name in _SAME_FOR_ALL}


def _page(pilot: Pilot, seed: int, decisions: int) -> str:
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
        seed=seed,
        seconds=f"{decisions * world.decision_period:g}",
    )
