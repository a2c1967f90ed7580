"""Columns by role: time, rates, wheel speeds and attitude, by a mapping or by common names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from satid_gym.config import check_names
from satid_gym.telemetry.log import CHANNELS
from satid_gym.telemetry.tables import Column

ROLES = ("time", *CHANNELS)
HOW = (
    "--columns time=unix_s rate=gx,gy,gz wheel_speed=w1,w2,w3 "
    '(Python: columns={"time": "unix_s", "rate": ["gx", "gy", "gz"], "wheel_speed": ["w1", "w2", "w3"]}), '
    "with attitude, torque and motor_torque where there are any"
)
_AXIS = re.compile(r"^(.*?)[\s_.\-\[]*([xyzws]|\d)\]?$")
_NUMBERED = re.compile(r"^(?:rw|rwa|wheel|reaction_?wheel)_?(\d)[\W_](?:speed|omega|rate|velocity|vel)$")  # "RW1_SPEED"
_WHEELS_MIN = 3
_TIME = {"time", "timestamp", "t", "unix", "epoch", "utc", "date", "datetime", "stamp", "seconds"}
_RATE = {"gyro", "gyr", "gyroscope", "rate", "rates", "omega", "angular", "angvel", "imu", "bodyrate"}
_WHEEL = {"rw", "rwa", "wheel", "wheels", "reaction", "rwspeed", "tachometer", "tacho"}
_ATTITUDE = {"q", "quat", "quaternion", "attitude", "qbi", "qib"}
_OTHER = {
    *("cmd", "cmds", "command", "commands", "commanded", "torque", "torques", "current", "temp", "temperature"),
    *("acc", "accel", "acceleration", "momentum", "angle", "mag"),
    *("target", "ref", "reference", "setpoint", "error", "std"),
    *("flag", "status", "voltage"),
}
_STEMS = _RATE | _WHEEL | _ATTITUDE | {"g", "w", "om", "speed"}  # that an axis may follow without a separator


def choose(columns: Sequence[Column], named: Mapping[str, str | Sequence[str]] | None) -> dict[str, list[Column]]:
    """Columns of each role, in order; several "time" columns, one a file, where the files have their own.

    Args:
        columns: of all files of a flight.
        named: names by role, as given by the user; time, rates and wheel speeds that it lacks, and all if it is None,
            are found by common names.

    Raises:
        ValueError: a named column is not there, or what is needed cannot be found or is there twice; the message lists
            what the files hold.
    """
    found = _guessed(columns) if named is None else _named(columns, named)
    for role in ("time", "rate", "wheel_speed"):
        if not found.get(role):
            raise ValueError(f"found no columns for {role} among {_listed(columns)}; say which: {HOW}")
    for role, size in (("rate", 3), ("attitude", 4), ("torque", 3)):
        if role in found and len(found[role]) != size:
            raise ValueError(_counted(role, str(size), found[role], columns))
    if len(found["wheel_speed"]) < _WHEELS_MIN:
        raise ValueError(_counted("wheel_speed", f"{_WHEELS_MIN} or more", found["wheel_speed"], columns))
    return found


def _counted(role: str, size: str, found: Sequence[Column], columns: Sequence[Column]) -> str:
    names = [column.header for column in found]
    return f"{role} takes {size} columns, found {len(names)}, {names}, among {_listed(columns)}; say which: {HOW}"


def _listed(columns: Sequence[Column]) -> str:
    files: dict[str, list[str]] = {}
    for column in columns:
        files.setdefault(column.file.name, []).append(column.header)
    return "; ".join(f"{file}: {', '.join(headers)}" for file, headers in files.items())


def _named(columns: Sequence[Column], named: Mapping[str, str | Sequence[str]]) -> dict[str, list[Column]]:
    check_names("role of columns", named, ROLES)
    found: dict[str, list[Column]] = {}
    for role, names in named.items():
        for name in [names] if isinstance(names, str) else names:
            here = [column for column in columns if name in (column.header, column.name)]
            if not here or (len(here) > 1 and role != "time"):
                there = "twice" if here else "not"
                raise ValueError(f"column {name!r} for {role} is {there} there; the files hold {_listed(columns)}")
            found.setdefault(role, []).extend(here)
    left = [column for column in columns if not any(column in mine for mine in found.values())]
    if "time" not in named:
        found["time"] = _times(left)
    lacking = [role for role in ("rate", "wheel_speed") if role not in named]
    guessed = _guessed([column for column in left if _role(column)[0] in lacking]) if lacking else {}
    return {**found, **{role: guessed[role] for role in lacking if role in guessed}}


def _guessed(columns: Sequence[Column]) -> dict[str, list[Column]]:
    found: dict[str, dict[str, Column]] = {}
    for column in columns:
        role, axis = _role(column)
        if role not in ("", "time"):
            place = found.setdefault(role, {})
            if axis in place:
                raise _both(place[axis], column, f"{role} {axis}", columns)
            place[axis] = column
    chosen = {role: [place[axis] for axis in sorted(place)] for role, place in found.items()}
    if "attitude" in found and len(found["attitude"]) != 4:
        del chosen["attitude"]
    return {"time": _times(columns), **chosen}


def _times(columns: Sequence[Column]) -> list[Column]:
    """Columns of time, one a file."""
    found: dict[str, Column] = {}
    for column in columns:
        if _role(column)[0] == "time":
            if str(column.file) in found:
                raise _both(found[str(column.file)], column, "time", columns)
            found[str(column.file)] = column
    return list(found.values())


def _both(first: Column, second: Column, what: str, columns: Sequence[Column]) -> ValueError:
    names = f"both {first.header!r} and {second.header!r}"
    return ValueError(f"{names} may be {what}; the files hold {_listed(columns)}; say which: {HOW}")


def _role(column: Column) -> tuple[str, str]:
    """Role and axis of a column by its name, or by its file's name where its own is an axis alone."""
    name = re.sub(r"([a-z])([A-Z])", r"\1_\2", column.name).lower()
    if set(re.split(r"[\W_]+", name)) & _TIME:
        return "time", ""
    if numbered := _NUMBERED.match(name):
        return "wheel_speed", numbered[1]
    found = _AXIS.match(name)
    if not found:
        return "", ""
    base, axis = found[1], found[2]
    file = base == ""
    words = set(re.split(r"[\W_\d]+", (column.file.stem if file else base).lower())) - {""}
    last = re.split(r"[\W_\d]+", base)[-1]
    glued = axis.isalpha() and last != "" and name[len(base)] == axis  # no separator: "gyrox", but also "gyro_quality"
    if words & _OTHER or (glued and last not in _STEMS):
        return "", ""
    if words & _ATTITUDE or (file and column.name.lower().startswith("q")):
        return "attitude", axis
    if axis in ("w", "s"):  # of a quaternion alone; "rates" and "wheels" are no axes
        return "", ""
    if words & _WHEEL or (base == "w" and axis.isdigit()):
        return "wheel_speed", axis
    if words & _RATE or (base in ("g", "w", "om") and axis in "xyz"):
        return "rate", axis
    return "", ""


def scalar_first(columns: Sequence[Column]) -> bool:
    """Whether four columns of a quaternion, by their names in order, begin with the scalar: q0 to q3 do, q1 to q4 not.

    Those that were guessed are sorted: w or s for the scalar comes before x.
    """
    first = _AXIS.match(columns[0].name.lower())
    return first is not None and first[2] in ("0", "w", "s")
