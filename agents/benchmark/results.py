"""Results of a comparison as `python -m agents.compare` writes them: read, and checked before they are used."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from satid_gym.files import DamagedFileError, read_json

_CELL = ("policy", "satellite", "inertia_mode")
_INTERVAL = ("final_error_lo", "final_error_hi", "mean_error_lo", "mean_error_hi")
_SCORES = ("reward", "outside_fraction", "saturated_fraction", "terminated_fraction", "information_nats", "effort")
_TEXT: dict[str, tuple[str, ...]] = {
    "records": (*_CELL, "kind"),
    "pairs": (*_CELL, "other"),
    "bounds": _CELL,
    "efficiencies": _CELL,
}
_NUMBERS: dict[str, tuple[str, ...]] = {
    "records": ("final_error_mean", "mean_error_mean", *_INTERVAL, *_SCORES, "time_to_1pct_s", "nees"),
    "pairs": ("difference_mean", "difference_lo", "difference_hi"),
    "bounds": ("final_error",),
    "efficiencies": ("efficiency", "excitation_efficiency", "decision_ms"),
}
_MAY_BE_NONE = ("time_to_1pct_s", "nees")  # never reached, or of no episode
_LISTS = ("time", "curves")
_OBJECTS = ("settings", "seeds", "versions", "scenario", "episode")


def file_names(scenario: str, control: str = "torque") -> dict[str, str]:
    """Names of a scenario's files: `results`, `curves` and `page`; apart for body rates as actions."""
    end = ("" if scenario == "default" else f"_{scenario}") + ("" if control == "torque" else f"_{control}")
    return {"results": f"compare{end}.json", "curves": f"report_data{end}.json", "page": f"report{end}.html"}


def files_of(results: Mapping[str, Any]) -> dict[str, str]:
    """Names of the files of a comparison's results."""
    settings = results["settings"]
    return file_names(settings["scenario"], settings.get("control", "torque"))  # which older results lack


def read_results(path: Path, remedy: str, *, keys: Iterable[str]) -> dict[str, Any]:
    """Read compare.json and check what is used of it: `keys`, and the rows of its tables.

    Args:
        path: the file.
        remedy: what to do where it is missing or damaged; ends the error's line.
        keys: names it must have.

    Raises:
        DamagedFileError: it is missing, not JSON, or holds what no comparison writes; the message says where.
    """
    values = read_json(path, remedy, keys=keys)
    for name in keys:
        wrong = _table_fault(name, values[name]) if name in _TEXT else _fault(name, values[name])
        if wrong:
            raise DamagedFileError(f"{path} is damaged: {wrong}: {remedy}")
    if wrong := _stored_fault(values.get("stored")):  # absent from results of older revisions
        raise DamagedFileError(f"{path} is damaged: {wrong}: {remedy}")
    return values


def read_curves(path: Path, remedy: str, *, keys: Iterable[str]) -> dict[str, Any]:
    """Read report_data.json as `read_results` does; its `bounds` are series against time, not rows of a table.

    Raises:
        DamagedFileError: as of `read_results`.
    """
    values = read_json(path, remedy, keys=keys)
    for name in keys:
        wrong = _list_fault(name, values[name]) if name == "bounds" else _fault(name, values[name])
        if wrong:
            raise DamagedFileError(f"{path} is damaged: {wrong}: {remedy}")
    return values


def _fault(name: str, value: Any) -> str | None:
    """What is wrong with a value that is no table; None where nothing is."""
    if name in _LISTS:
        return _list_fault(name, value)
    if name not in _OBJECTS:
        return None if isinstance(value, str) else f"{name} must be text, got {_short(value)}"
    if not isinstance(value, Mapping):
        return f"{name} must be an object, got {_short(value)}"
    if name == "settings":
        for key in ("satellites", "modes"):
            names = value.get(key)
            if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
                return f"{key} of settings must be a list of names, got {_short(names)}"
    return None


def _stored_fault(stored: Any) -> str | None:
    """What is wrong with stored figures; None where nothing is."""
    if stored is None:
        return None
    if not isinstance(stored, Mapping):
        return f"stored must be an object, got {_short(stored)}"
    for name in ("records", "efficiencies", "notes", "file", "revision"):
        if name not in stored:
            return f"stored has no {name}"
    return _table_fault("records", stored["records"]) or _table_fault("efficiencies", stored["efficiencies"])


def _list_fault(name: str, value: Any) -> str | None:
    return None if isinstance(value, list) else f"{name} must be a list, got {_short(value)}"


def _table_fault(name: str, rows: Any) -> str | None:
    """What is wrong with a table; None where nothing is."""
    if not isinstance(rows, list):
        return _list_fault(name, rows)
    for i, row in enumerate(rows):
        if not isinstance(row, Mapping):
            return f"row {i} of {name} must be an object, got {_short(row)}"
        for column in (*_TEXT[name], *_NUMBERS[name]):
            if column not in row:
                return f"row {i} of {name} has no {column}"
        for column in _TEXT[name]:
            if not isinstance(row[column], str):
                return f"{column} in row {i} of {name} must be text, got {_short(row[column])}"
        for column in _NUMBERS[name]:
            if not (_is_number(row[column]) or (row[column] is None and column in _MAY_BE_NONE)):
                return f"{column} in row {i} of {name} must be a finite number, got {_short(row[column])}"
    return None


def _is_number(value: Any) -> bool:
    """Whether it is a number that a float can hold; True and False are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
