"""Subcommand `satid check`: a data sheet looked over before it is believed."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence
from typing import Any

from satid_gym.commands.words import HelpFormatter
from satid_gym.data_sheet import DerivedMode, derived, doubts, left_out
from satid_gym.resolution import resolve_satellites
from satid_gym.satellite import Satellite

_EXAMPLES = """examples:
  satid check sat.toml
  satid check microsat
"""


def add(parts: Any) -> None:
    """Add the subcommand."""
    own = parts.add_parser(
        "check",
        help="look over a data sheet: what follows from it, what it leaves out, and doubts",
        description="Print what follows from a data sheet, which values are defaults or taken as nominal, and what is "
        "hard to believe, such as a value in another unit. The exit code is 1 if there are doubts.",
        epilog=_EXAMPLES,
        formatter_class=HelpFormatter,
    )
    own.add_argument("satellite", help="name or file")
    own.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Print it; 1 if there are doubts, else 0.

    Raises:
        ValueError: the data sheet is not valid.
    """
    satellites = resolve_satellites(given.satellite)
    for satellite in satellites:
        _show(satellite)
    return int(any(map(doubts, satellites)))


def _show(satellite: Satellite) -> None:
    own, wheels = derived(satellite), satellite.wheels
    print(f"{satellite.name}: {wheels.count} wheels, rate limit {satellite.rate_limit:g} rad/s\n")
    rows = {
        "moment, kg m^2": own.moment,
        "torque of all wheels, N m": own.torque,
        "from rest to the rate limit, s": own.to_limit,
        "rate by wheels at their speed limit, rad/s": own.reached,
        "moment over a uniform box's": own.box,
    }
    print(f"{'about':44s}" + "".join(f"{axis:>12s}" for axis in "xyz"))
    for name, values in rows.items():
        if values is not None:
            print(f"{name:44s}" + "".join(f"{value:12.4g}" for value in values))
    _show_modes(own.modes)
    print("\nwheels from rest to their speed limit, s: " + " ".join(f"{value:.4g}" for value in own.spin_up))
    _list("not in the data sheet, or as the default", left_out(satellite), "nothing: everything is given")
    _list("doubts", doubts(satellite), "none")


def _show_modes(modes: Sequence[DerivedMode]) -> None:
    """Table of panels and tanks."""
    if not modes:
        return
    print(f"\n{'panels and tanks':20s}{'held, Hz':>10s}{'free, Hz':>10s}", end="")
    print(f"{'share of x, y, z, %':>22s}{'deflection':>14s}{'its limit':>11s}")
    for number, mode in enumerate(modes, 1):
        limit = "none" if mode.limit is None else f"{mode.limit:.3g}"
        share = " ".join(f"{100.0 * value:.1f}" for value in mode.share)
        print(f"{f'{number}, {mode.kind}':20s}{mode.held:10.3g}{mode.free:10.3g}", end="")
        print(f"{share:>22s}{f'{mode.deflection:.2g} {mode.unit}':>14s}{limit:>11s}")
    print("  frequency with the body held and free to turn; share of the moments that moves with")
    print("  the mode; largest deflection after a step from no torque to all of it about an axis")


def _list(title: str, lines: list[str], without: str) -> None:
    print(f"\n{title}: {'' if lines else without}".rstrip())
    for line in lines:
        print(textwrap.fill(line, 80, initial_indent="  - ", subsequent_indent="    "))
