"""Units of telemetry: their names, and the factors to SI."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping

from satid_gym.config import unknown_name

RPM, DEGREE = math.pi / 30.0, math.pi / 180.0
_NAMES: dict[str, tuple[float, tuple[str, ...]]] = {
    "rad/s": (1.0, ("rads", "radps")),
    "mrad/s": (1e-3, ("mrads",)),
    "deg/s": (DEGREE, ("degs", "dps", "degps")),
    "mdeg/s": (1e-3 * DEGREE, ("mdegs", "mdps")),
    "deg/h": (DEGREE / 3600.0, ("degh", "dph", "deghr", "deghour")),
    "rpm": (RPM, ("revmin", "umin", "1min")),
    "krpm": (1e3 * RPM, ()),
    "rev/s": (60.0 * RPM, ("revs", "rps")),
    "Nm": (1.0, ("newtonmeter", "newtonmetre")),
    "mNm": (1e-3, ()),
    "uNm": (1e-6, ()),
    "s": (1.0, ("unix", "unixs")),
    "ms": (1e-3, ("millis",)),
    "us": (1e-6, ("micros",)),
    "ns": (1e-9, ("nanos",)),
}
_SHORT = {"°": "deg", "degrees": "deg", "degree": "deg", "µ": "u", "per": "", "seconds": "s", "second": "s", "sec": "s"}
SPEEDS = ("rad/s", "mrad/s", "deg/s", "mdeg/s", "deg/h", "rpm", "krpm", "rev/s")
TIMES, TORQUES = ("s", "ms", "us", "ns"), ("Nm", "mNm", "uNm")
ALLOWED = {"time": TIMES, "rate": SPEEDS, "wheel_speed": SPEEDS, "torque": TORQUES, "motor_torque": TORQUES}
ORDERS = ("scalar first", "scalar last")
_HEADER = re.compile(r"^(.*?)[\s_]*[\[(]([^\])]*)[\])]\s*$")
_ENDING = re.compile(
    r"^(.+?)[\s_](k?rpm|m?dps|m?deg_?s|m?deg/s|deg/h|rad_?s|rad/s|mrad_?s|rev/s|[mu]?n_?m|ms|us|ns|s)$",
    flags=re.IGNORECASE,
)
_INDEXED = re.compile(r"^(.+?)\s*[\[(](\d)[\])]$")
_UNITLIKE = re.compile(r"[/°]|^[kmuµ]?(rad|deg|rev|rpm|hz|nm|n m)", flags=re.IGNORECASE)


def unit_of(text: str) -> str | None:
    """Unit that a text such as "°/s", "RPM" or "deg/sec" stands for; None if it is not known."""
    plain = text.strip().lower()
    for long, short in _SHORT.items():
        plain = plain.replace(long, short)
    if plain in _NAMES:
        return plain
    squeezed = re.sub(r"[^a-z0-9]", "", plain)
    for unit, (_, others) in _NAMES.items():
        if squeezed == re.sub(r"[^a-z]", "", unit.lower()) or squeezed in others:
            return unit
    return None


def split_header(header: str) -> tuple[str, str | None]:
    """Name and unit of a column: "gx [deg/s]", "w1 (rpm)", "rate_x_dps", "rw_rpm[0]".

    What stands in brackets and looks like a unit is one, known or not; else it stays in the name.
    """
    text, index = header.strip(), ""
    if found := _INDEXED.match(text):
        text, index = found[1], f"_{found[2]}"
    for pattern in (_HEADER, _ENDING):
        found = pattern.match(text)
        if found and unit_of(found[2]):
            return found[1] + index, unit_of(found[2])
        if found and pattern is _HEADER and _UNITLIKE.search(found[2]):
            return found[1] + index, found[2]
    return header.strip(), None


def option_of(units: Mapping[str, str]) -> str:
    """How to give these units by role, on the command line and in Python."""
    words = " ".join(shlex.quote(f"{role}={unit}") for role, unit in units.items())
    python = ", ".join(f'"{role}": "{unit}"' for role, unit in units.items())
    return f"--units {words} (Python: units={{{python}}})"


def turned_unit(units: Mapping[str, str], role: str) -> str:
    """Unit with the opposite sign of the one that a role's columns are in; rad/s where none is stated."""
    unit = units.get(role, "rad/s")
    return unit.strip()[1:] if unit.strip().startswith("-") else f"-{unit}"


def factor(role: str, unit: str) -> float:
    """Factor to SI; a minus sign before the unit turns the sign as well.

    Raises:
        ValueError: the unit is not one of the role's.
    """
    sign = -1.0 if unit.strip().startswith("-") else 1.0
    known = unit_of(unit.strip().removeprefix("-"))
    if known not in ALLOWED[role]:
        raise unknown_name(f"unit of {role}", unit, ALLOWED[role])
    return sign * _NAMES[known][0]
