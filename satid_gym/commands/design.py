"""Subcommand `satid design`: the manoeuvre for a satellite, as CSV, JSON, a picture and a page."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np

from satid_gym.commands.words import HelpFormatter, as_typed
from satid_gym.config import check_number
from satid_gym.files import check_writable, write_bytes, write_json, write_text
from satid_gym.manoeuvres import Effort, KeepOut, design
from satid_gym.manoeuvres.record import csv, lines, record
from satid_gym.problem import CONTROLS
from satid_gym.resolution import resolve_scenario
from satid_gym.scenario import Scenario

_EXAMPLES = """examples:
  satid design microsat
  satid design sat.toml --duration 600 --accuracy 0.0005 --returns
  satid design sat.toml --turn-limit 30 --keep-out 0,0,1:1,0,0:35

A keep-out is BORESIGHT:DIRECTION:DEGREES, both in the body frame at the start; write --keep-out=-1,0,0:...
if it begins with a minus sign. The default search takes minutes.
"""


def add(parts: Any) -> None:
    """Add the subcommand."""
    own = parts.add_parser(
        "design",
        help="manoeuvre that identifies a satellite's inertia",
        description="Design the manoeuvre that identifies a satellite's inertia best, within the limits of its data "
        "sheet: from rest to rest by a rate loop, from rest by torque in open loop.",
        epilog=_EXAMPLES,
        formatter_class=HelpFormatter,
    )
    own.add_argument("satellite", help="data sheet: name, .toml or .json file")
    own.add_argument(
        "--duration", type=float, default=300.0, metavar="S", help="s, by rates from rest to rest; default 300"
    )
    own.add_argument(
        "--accuracy", type=float, metavar="STD", help="required of every moment, relative; default: the best possible"
    )
    own.add_argument(
        "--uncertainty",
        type=float,
        metavar="STD",
        help="std of the data sheet's moments of inertia, relative; default: the scenario's, 0.15",
    )
    own.add_argument("--returns", action="store_true", help="end in the initial attitude")
    own.add_argument("--turn-limit", type=float, metavar="DEG", help="largest angle from that attitude")
    own.add_argument(
        "--keep-out", action="append", default=[], metavar="CONE", help="cone that a boresight avoids; may be repeated"
    )
    own.add_argument("--control", choices=CONTROLS, default="rate", help="rate: by a rate loop; torque: open loop")
    own.add_argument("--scenario", default="default", help="name or file: noise, prior and periods")
    own.add_argument("--rounds", type=int, default=Effort.rounds, help=f"rounds of the search; default {Effort.rounds}")
    own.add_argument("--seed", type=int, default=0, help="seed of the search")
    own.add_argument("--output", type=Path, default=Path("design"), help="folder; default design")
    own.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Design, write, and show the tables.

    Raises:
        ValueError: an argument is not valid, or no manoeuvre does what is asked.
    """
    keep_outs = [_keep_out(word) for word in given.keep_out]
    if given.turn_limit is not None:
        check_number("--turn-limit", given.turn_limit, strict=True, high=180.0)
    check_writable(given.output, stays=False)
    found = design(
        given.satellite,
        duration=given.duration,
        accuracy=given.accuracy,
        returns=given.returns,
        turn_limit=None if given.turn_limit is None else np.radians(given.turn_limit),
        keep_outs=keep_outs,
        scenario=_world(given.scenario, given.uncertainty),
        control=given.control,
        effort=Effort(rounds=given.rounds, seed=given.seed),
        progress=lambda line: print(f"{line} ...", file=sys.stderr, flush=True),
    )
    print("\n".join(lines(found)))
    for note in found.notes:
        print(f"note: {note}", file=sys.stderr)
    command = as_typed(given.words)
    write_text(given.output / "manoeuvre.csv", csv(found))
    write_json(given.output / "design.json", {"command": command, **record(found)})
    written = ["manoeuvre.csv", "design.json"]
    if importlib.util.find_spec("matplotlib") is None:
        print('note: for the figure and the page, pip install ".[telemetry]" in the checkout', file=sys.stderr)
    else:
        from satid_gym.manoeuvres.figure import png
        from satid_gym.manoeuvres.page import page

        picture = png(found)
        write_bytes(given.output / "design.png", picture)
        write_text(given.output / "design.html", page(found, picture, command))
        written += ["design.png", "design.html"]
    print(f"\nwritten to {given.output}: {', '.join(written)}")
    return 0


def _world(scenario: str, uncertainty: float | None) -> Scenario:
    """The scenario whose inertia is so uncertain; the filter's prior is wider by what it is wider in the scenario."""
    world = resolve_scenario(scenario)
    if uncertainty is None:
        return world
    check_number("--uncertainty", uncertainty, strict=True, high=1.0)
    wider = world.prior_std / world.inertia_std if world.inertia_std > 0.0 else 2.0
    return world.replace(inertia_std=uncertainty, prior_std=wider * uncertainty)


def _keep_out(word: str) -> KeepOut:
    """Keep-out of BORESIGHT:DIRECTION:DEGREES."""
    try:
        boresight, direction, angle = word.split(":")
        vectors = [[float(part) for part in vector.split(",")] for vector in (boresight, direction)]
        degrees = float(angle)
    except ValueError:
        raise ValueError(f"--keep-out takes BORESIGHT:DIRECTION:DEGREES such as 0,0,1:1,0,0:35, got {word!r}") from None
    if not 0.0 < degrees < 180.0:
        raise ValueError(f"--keep-out takes an angle between 0 and 180 degrees, got {angle}")
    return KeepOut(boresight=np.array(vectors[0]), direction=np.array(vectors[1]), angle=float(np.radians(degrees)))
