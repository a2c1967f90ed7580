"""Subcommand `satid export`: filter, policy and rate loop as C99 for a flight computer."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from satid_gym.commands.words import HelpFormatter
from satid_gym.files import check_writable
from satid_gym.flightcode import write
from satid_gym.flightcode.measure import measures
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.onboard.choice import check_control
from satid_gym.onboard.pilot import Pilot
from satid_gym.problem import CONTROLS

_EXAMPLES = """examples:
  satid export --output flightcode
  satid export --satellite sat.toml --policy rate_square --measure
  make -C flightcode
"""


def add(parts: Any) -> None:
    """Add the subcommand."""
    own = parts.add_parser(
        "export",
        help="filter, policy and rate loop as C99",
        description="Write a Pilot as C99 without dynamic memory, with test vectors of a flight.",
        epilog=_EXAMPLES,
        formatter_class=HelpFormatter,
    )
    own.add_argument("--satellite", default="microsat", help="name or file; default microsat")
    own.add_argument(
        "--policy",
        default="generalist",
        help="shipped policy, tuned baseline, path of a policy, or design.json of satid design; default generalist",
    )
    own.add_argument("--scenario", default="default", help="name or file")
    own.add_argument("--estimator", help="filter, name or JSON of its settings; default the scenario's")
    own.add_argument("--control", choices=CONTROLS, default="torque", help="what actions are; default torque")
    own.add_argument("--patience", type=float, help="s without gyro until zero torque; default three decisions")
    own.add_argument("--seed", type=int, default=0, help="seed of the test vectors' flight")
    own.add_argument("--output", type=Path, default=Path("flightcode"), help="folder; default flightcode")
    own.add_argument("--measure", action="store_true", help="compile the code, and print sizes, operations and times")
    own.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Write the code, and say where it is.

    Raises:
        ValueError: a name or file is not valid, the policy has no C, or there is no compiler to measure with.
    """
    check_control(given.policy, given.control)
    check_writable(given.output, stays=False)
    pilot = Pilot(
        given.satellite,
        given.policy,
        scenario=given.scenario,
        estimator=_estimator(given.estimator),
        control=given.control,
        patience=given.patience,
        seed=given.seed,
    )
    if isinstance(pilot.policy, ManoeuvrePolicy) and (doubt := pilot.policy.doubt(pilot.mission.satellite)):
        print(f"note: {doubt}", file=sys.stderr)
    names = write(given.output, pilot)
    print(f"written to {given.output}: {', '.join(names)}")
    if given.measure:
        print("\n".join(measures(given.output, pilot)))
    return 0


def _estimator(text: str | None) -> Any:
    """Name of a filter, or its settings from JSON."""
    if text is None or not text.startswith("{"):
        return text
    try:
        return json.loads(text)
    except ValueError as error:
        raise ValueError(f"--estimator {text} is not JSON: {error}") from error
