"""Subcommand `satid identify`: inertia from recorded flights, as JSON, a picture and a page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from satid_gym.commands.words import HelpFormatter, as_typed
from satid_gym.files import check_writable, write_bytes, write_json, write_text
from satid_gym.identification import identify
from satid_gym.identification.record import lines, record, variation_lines
from satid_gym.telemetry import read_logs

_EXAMPLES = """examples:
  satid identify flight.csv --satellite microsat
  satid identify flights/ --satellite sat.toml --output results
  satid identify flight.csv --satellite microsat --varying
  satid identify a.parquet b.parquet --satellite sat.toml \\
      --columns time=unix_s rate=gx,gy,gz wheel_speed=w1,w2,w3 \\
      --units rate=deg/s wheel_speed=rpm

A file is one flight; a folder is one flight if it holds files, and so is each folder below it. Without --columns and
--units names and units are those of files and headers; what cannot be guessed is said.
"""


def add(parts: Any) -> None:
    """Add the subcommand."""
    own = parts.add_parser(
        "identify",
        help="inertia from recorded gyro and wheel speeds",
        description="Identify the inertia tensor from recorded gyro and wheel speeds, with intervals whose coverage is "
        "tested.",
        epilog=_EXAMPLES,
        formatter_class=HelpFormatter,
    )
    own.add_argument("log", nargs="+", type=Path, metavar="LOG", help="CSV or Parquet file, or folder")
    own.add_argument("--satellite", required=True, help="name, .toml or .json file: wheels as built, nominal inertia")
    own.add_argument(
        "--columns",
        nargs="+",
        default=[],
        metavar="ROLE=NAMES",
        help="roles: time, rate, wheel_speed, attitude, torque (external, on the body), motor_torque",
    )
    own.add_argument("--units", nargs="+", default=[], metavar="ROLE=UNIT", help="such as rate=deg/s wheel_speed=-rpm")
    own.add_argument("--window", type=float, default=40.0, help="s of a window with constant torque; default 40")
    own.add_argument("--varying", action="store_true", help="also test how the inertia varies over time: steps, drifts")
    own.add_argument("--output", type=Path, default=Path("identification"), help="folder; default identification")
    own.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Read, identify, write, and show the table.

    Raises:
        ValueError: files, columns, units or satellite are not valid, or the logs tell nothing.
    """
    columns = {role: names.split(",") for role, names in _pairs("columns", given.columns)}
    units = dict(_pairs("units", given.units))
    check_writable(given.output, stays=False)
    logs = read_logs(given.log, columns or None, units)
    flights = f"{len(logs)} flight{'s' * (len(logs) > 1)}"
    print(f"{flights}, {sum(map(len, logs))} readings; identifying ...", file=sys.stderr)
    found = identify(logs, given.satellite, window=given.window, varying=given.varying)
    print("\n".join(lines(found)))
    if found.variation is not None:
        print("\n".join(["", *variation_lines(found.variation)]))
    for note in found.notes:
        print(f"note: {note}", file=sys.stderr)
    command = as_typed(given.words)
    write_json(given.output / "identification.json", {"command": command, **record(found)})
    written = ["identification.json"]
    try:
        from satid_gym.identification.figure import png
        from satid_gym.identification.page import page

        picture = png(found)
    except ValueError as error:
        print(f"note: {error}", file=sys.stderr)
    else:
        write_bytes(given.output / "identification.png", picture)
        write_text(given.output / "identification.html", page(found, picture, command))
        written += ["identification.png", "identification.html"]
    print(f"\nwritten to {given.output}: {', '.join(written)}")
    return 0


def _pairs(option: str, words: list[str]) -> list[tuple[str, str]]:
    pairs = []
    for word in words:
        role, sign, value = word.partition("=")
        if not (role and sign and value):
            raise ValueError(f"--{option} takes ROLE=VALUE, got {word!r}")
        pairs.append((role, value))
    return pairs
