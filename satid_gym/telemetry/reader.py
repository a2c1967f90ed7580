"""Reader of telemetry: files to a `Log`, with increasing time stamps and channels on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from satid_gym.config import check_names, unknown_name
from satid_gym.telemetry.columns import ROLES, choose, scalar_first
from satid_gym.telemetry.log import GAP, REPEATS_MAX, Log
from satid_gym.telemetry.tables import ENDINGS, Column, read_table
from satid_gym.telemetry.units import ALLOWED, ORDERS, factor

PathText = str | PathLike[str]
Columns = Mapping[str, str | Sequence[str]]
_STUCK_MIN = 20  # rows that a sensor does not repeat by chance


def read_log(
    paths: PathText | Sequence[PathText], columns: Columns | None = None, units: Mapping[str, str] | None = None
) -> Log:
    """Log of one flight from CSV or Parquet files.

    Units are taken from `units`, else from cells ("4.65 °/s") or headers ("gx [deg/s]", "w1_rpm"), else they are SI.
    Time may be in seconds of any clock or in dates. Rows without a stamp and rows whose stamp was there before are left
    out, rows are sorted by time, and a channel with stamps of its own is interpolated to the gyro's, not across gaps. A
    reading of gyro or wheel that repeats for long, and hardly ever else, is taken to be stuck and left out.

    Args:
        paths: one file, several files of one flight, or a folder of them.
        columns: names by role, such as {"time": "unix_s", "rate": ["gx", "gy", "gz"], "wheel_speed": ["w1", "w2",
            "w3"], "attitude": ["qx", "qy", "qz", "qw"]}, also "torque" and "motor_torque" (see `Log`), which are never
            guessed; None: by common names.
        units: by role, such as {"rate": "deg/s", "wheel_speed": "rpm", "time": "ms", "attitude": "scalar first"}; a
            minus sign turns the sign: "-rpm".

    Raises:
        ValueError: a file, column or unit is not there or cannot be guessed; the message lists what was found.
    """
    given = [paths] if isinstance(paths, (str, PathLike)) else list(paths)
    files = [file for path in given for file in _files(Path(path))]
    table = [column for file in files for column in read_table(file)]
    chosen = choose(table, columns)
    units = dict(units or {})
    check_names("role of units", units, ROLES) if units else None
    notes: list[str] = []
    clocks = {column.file: _in_units("time", [column], units, notes)[:, 0] for column in chosen["time"]}
    channels = {role: _channel(role, chosen, clocks, units, notes) for role in ROLES[1:] if role in chosen}
    time, rate = channels.pop("rate")
    held = {role: _at(time, *channel) for role, channel in channels.items()}
    name = Path(given[0]).name if len(given) == 1 else Path(given[0]).parent.name or "log"
    told = {role: chosen[role][0].unit for role in ALLOWED if role in chosen}
    used = {role: units.get(role) or unit or ALLOWED[role][0] for role, unit in told.items()}
    stated = frozenset(role for role, unit in told.items() if unit == used[role])
    return replace(_ordered(time, {"rate": rate, **held}, name, notes), units=used, stated=stated)


def read_logs(
    paths: PathText | Sequence[PathText], columns: Columns | None = None, units: Mapping[str, str] | None = None
) -> list[Log]:
    """Logs of several flights: each file is one, and each folder that holds files, at any depth, is one.

    Arguments are those of `read_log`.

    Raises:
        ValueError: as `read_log`; the message names the flight.
    """
    flights: list[Path] = []
    for path in [paths] if isinstance(paths, (str, PathLike)) else list(paths):
        folder = Path(path)
        if not folder.is_dir():
            flights.append(folder)
            continue
        inside = [folder, *sorted(below for below in folder.rglob("*") if below.is_dir())]
        found = [below for below in inside if _tables_in(below)]
        if not found:
            raise ValueError(f"{folder} holds no files of telemetry ({', '.join(ENDINGS)}), at any depth")
        flights += found
    return [read_log(flight, columns, units) for flight in flights]


def _tables_in(folder: Path) -> list[Path]:
    return sorted(
        file for file in folder.iterdir() if file.is_file() and file.suffix.lower() in ENDINGS[:2] + ENDINGS[3:]
    )


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    if found := _tables_in(path):
        return found
    raise ValueError(
        f"{path} holds no files of telemetry ({', '.join(ENDINGS)}); read_logs looks in its folders as well"
    )


def _in_units(role: str, columns: list[Column], units: Mapping[str, str], notes: list[str]) -> np.ndarray:
    """Values (N, k) in SI units."""
    own = {column.unit for column in columns}
    if role in units:
        unit = units[role]
    elif len(own) > 1:
        raise ValueError(f"the columns of {role} have the units {sorted(map(str, own))}, expected one for all")
    else:
        unit = own.pop() or ALLOWED[role][0]
        said = "as files say" if columns[0].unit else "because the files give no unit"
        note = f"{role} taken as {unit}, {said}"
        if note not in notes:  # each file has a clock
            notes.append(note)
    return factor(role, unit) * np.stack([column.values for column in columns], axis=1)


def _channel(
    role: str,
    chosen: Mapping[str, list[Column]],
    clocks: Mapping[Path, np.ndarray],
    units: Mapping[str, str],
    notes: list[str],
) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (N,) and values (N, k) of a role."""
    columns = chosen[role]
    files = {column.file for column in columns}
    if len(files) > 1:
        raise ValueError(f"the columns of {role} must be in one file, found them in {sorted(f.name for f in files)}")
    (file,) = files
    if file not in clocks and len(clocks) > 1:
        raise ValueError(f"{file.name}, which holds {role}, has no column of time")
    time = clocks[file] if file in clocks else next(iter(clocks.values()))
    if role != "attitude":
        values = _in_units(role, columns, units, notes)
    else:
        order = units.get(role, ORDERS[0] if scalar_first(columns) else ORDERS[1])
        if order not in ORDERS:
            raise unknown_name("order of attitude", order, ORDERS)
        if role not in units:
            notes.append(f"attitude taken as {order}, by the names {', '.join(c.header for c in columns)}")
        values = np.stack([column.values for column in columns], axis=1)
        values = np.roll(values, -1, axis=1) if order == ORDERS[0] else values
    if len(time) != len(values):
        raise ValueError(f"{role} has {len(values)} rows and its time {len(time)}")
    return time, values


def _at(wanted: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at other stamps: linear between neighbours that are no gap apart, NaN elsewhere."""
    if wanted.shape == time.shape and np.array_equal(wanted, time, equal_nan=True):
        return values
    good = np.isfinite(time)
    stamps, first = np.unique(time[good], return_index=True)
    values = values[good][first]
    if len(stamps) < 2:
        return np.full((len(wanted), values.shape[1]), np.nan)
    longest = GAP * float(np.median(np.diff(stamps)))
    if values.shape[1] == 4:  # quaternions: of the two signs the one near the row before
        turned = np.sign(np.where(np.sum(values[1:] * values[:-1], axis=1) < 0.0, -1.0, 1.0))
        values = values * np.concatenate([[1.0], np.cumprod(turned)])[:, None]
    after = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
    share = ((wanted - stamps[after - 1]) / (stamps[after] - stamps[after - 1]))[:, None]
    between = (1.0 - share) * values[after - 1] + share * values[after]
    inside = (share[:, 0] >= 0.0) & (share[:, 0] <= 1.0) & (stamps[after] - stamps[after - 1] <= longest)
    return np.where(inside[:, None], between, np.nan)


def _ordered(time: np.ndarray, channels: Mapping[str, np.ndarray], name: str, notes: list[str]) -> Log:
    """Log with stamps that increase."""
    keep = np.flatnonzero(np.isfinite(time))
    if len(keep) < len(time):
        notes.append(f"{len(time) - len(keep)} rows without a stamp left out")
    if (backwards := int((np.diff(time[keep]) < 0.0).sum())) > 0:
        notes.append(f"stamps went back {backwards} times; rows sorted by time")
    keep = keep[np.argsort(time[keep], kind="stable")]
    fresh = np.diff(time[keep], prepend=-np.inf) > 0.0
    if not fresh.all():
        notes.append(f"{int((~fresh).sum())} rows repeat a stamp and are left out")
    keep = keep[fresh]
    sensed = np.hstack([channels[role] for role in ("rate", "wheel_speed", "attitude") if role in channels])[keep]
    stale = np.concatenate([[False], (np.diff(sensed, axis=0) == 0.0).all(axis=1)])[: len(keep)]
    if stale.any():
        notes.append(f"{int(stale.sum())} rows repeat the readings of the row before and are left out")
    keep = keep[~stale]
    if len(keep) < 2:
        raise ValueError(
            f"{name}: expected two rows with stamps of their own or more, found {len(keep)}; time is one column of "
            "numbers, or of dates with their time of day such as 2026-01-31T12:00:00.5"
        )
    kept = {role: values[keep] for role, values in channels.items()}
    if "attitude" in kept:
        norm = np.linalg.norm(kept["attitude"], axis=1, keepdims=True)
        kept["attitude"] = np.where(
            np.abs(norm - 1.0) < 0.1, kept["attitude"] / np.where(norm > 0.0, norm, 1.0), np.nan
        )
    for role in ("rate", "wheel_speed"):
        _leave_out_stuck(role, kept[role], time[keep], notes)
    log = Log(time=time[keep], name=name, **kept)
    lost = int((~np.isfinite(np.hstack([log.rate, log.wheel_speed])).all(axis=1)).sum())
    if lost:
        notes.append(f"{lost} of {len(log)} rows have cells without a number")
    if log.gaps:
        notes.append(f"{len(log.gaps)} gaps, the longest of {max(gap for _, gap in log.gaps):.3g} s")
    return replace(log, notes=tuple(notes))


def _leave_out_stuck(role: str, values: np.ndarray, time: np.ndarray, notes: list[str]) -> None:
    """Take out of a channel (T, n) the longest stretch in which a column repeats its value, if else it hardly does.

    Not where all columns repeat theirs: body or wheels are at rest. Nor where it is the largest rate, either way,
    and comes back to it: that is the end of a gyro's range, which `satid_gym.identification.bad_readings` looks after.
    """
    rests = (np.diff(values, axis=0) == 0.0).all(axis=1)
    for k, column in enumerate(values.T):
        ends = np.concatenate([[-1], np.flatnonzero(np.diff(column) != 0.0), [len(column) - 1]])
        longest = int(np.argmax(np.diff(ends)))
        first, last = ends[longest] + 1, ends[longest + 1]
        repeats = len(column) - (len(ends) - 1) - (last - first)  # outside of it
        others = len(column) - (last - first + 1)
        if last - first + 1 - rests[first:last].sum() < _STUCK_MIN or (others and repeats > REPEATS_MAX * others):
            continue
        size = np.abs(column)
        if role == "rate" and size[first] == np.nanmax(size) and np.sum(size == size[first]) > last - first + 1:
            continue
        said = f"column {k + 1} of {role} repeats {column[first]:.6g} for {time[last] - time[first]:.6g} s"
        said += f", from row {first + 1} on"
        if others:
            notes.append(f"{said}: it is taken to be stuck there, and left out")
            column[first : last + 1] = np.nan
        elif column[first] != 0.0:
            notes.append(f"{said}, the whole flight: is that sensor stuck? If it is, the inertia is wrong")
