"""Sources of user-defined satellites, scenarios, inertia laws and code: a file's path, `module:name` or JSON text.

    my.toml, my.json        settings by name, as `from_dict` takes them; reading one runs no code
    law.csv                 of an inertia law: columns time, factor, or time, xx, yy, zz[, xy, xz, yz]
    mypackage.crafts:TILTED an attribute of a module; importing it runs the module's code
    {"name": ...}           JSON text, in which runs keep the settings they were started with

If a file gives no name, its own name without the ending is used.
"""

from __future__ import annotations

import csv
import importlib
import inspect
import json
import os
import re
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from satid_gym.config import Config, unknown_name
from satid_gym.laws import TABLE

SOURCE_HINT = "or the path of a .json or .toml file, or module:name"
_FILES = (".json", ".toml", ".csv")
_IN_MODULE = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)")
_FACTOR = ("time", "factor")
_MOMENTS = ("time", "xx", "yy", "zz")
_TENSOR = (*_MOMENTS, "xy", "xz", "yz")
_PLACES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}

T = TypeVar("T", bound=Config)


def is_source(text: object) -> bool:
    """Whether a text is a file's path, module:name or JSON, rather than a name in the catalogue."""
    return isinstance(text, str) and (text.startswith("{") or Path(text).suffix.lower() in _FILES or in_module(text))


def load(text: str, kind: type[T], build: Callable[[Mapping[str, Any]], T]) -> T:
    """Settings object from a source.

    Args:
        text: the source, see the module's docstring.
        kind: expected class.
        build: makes an object of that class from a mapping.

    Raises:
        ValueError: the file, module or name does not exist, or its content is not valid; the message names it.
    """
    inside = _IN_MODULE.fullmatch(text)
    try:
        if text.startswith("{"):
            return build(_json(text))
        if inside is not None:
            name, value = inside[2], _imported(inside[1], inside[2])
            if isinstance(value, type) or (callable(value) and not isinstance(value, kind)):
                value = value()
        else:
            name, value = Path(text).stem, _read(Path(text))
        if isinstance(value, Mapping):
            return build({"name": name, **value})
        if not isinstance(value, kind):
            raise ValueError(f"must be a {kind.__name__}, a mapping of its settings or a function that returns one")
        return value if getattr(value, "name", "") else value.replace(name=name)
    except ValueError as error:
        raise ValueError(f"{kind.__name__} {text if len(text) < 200 else text[:200] + '...'}: {error}") from error


def unknown(kind: str, text: object, names: Any) -> ValueError:
    """Error for a text that is neither a known name nor a source."""
    return ValueError(f"{unknown_name(kind, text, names)} {SOURCE_HINT[0].upper()}{SOURCE_HINT[1:]}.")


def imported(text: str) -> Any:
    """Object named by `module:name`; the module's code is run.

    Raises:
        ValueError: the text is not of this form, or the module or name does not exist.
    """
    inside = _IN_MODULE.fullmatch(text)
    if inside is None:
        raise ValueError(f"expected module:name, got {text!r}")
    return _imported(inside[1], inside[2])


def made(factory: Any, kind: str) -> Any:
    """What a class or function makes without arguments.

    Raises:
        ValueError: it is neither, or needs arguments.
    """
    try:
        inspect.signature(factory).bind()
    except TypeError as error:
        raise ValueError(
            f"{kind}: {factory!r} is not made without arguments ({error}): give an object, or functools.partial of it"
        ) from error
    return factory()


def in_module(text: str) -> bool:
    """Whether a text is module:name."""
    return _IN_MODULE.fullmatch(text) is not None


def _imported(module: str, name: str) -> Any:
    """Attribute of a module, which may lie in the current directory."""
    here = os.getcwd()
    away = here not in sys.path and "" not in sys.path
    if away:
        sys.path.append(here)  # last, so that it hides no installed module
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        raise ValueError(f"cannot import {module}: {error}") from error
    finally:
        if away:
            sys.path.remove(here)
    if not hasattr(found, name):
        raise unknown_name(f"name in {module}", name, [n for n in vars(found) if not n.startswith("_")])
    return getattr(found, name)


def _read(path: Path) -> Mapping[str, Any]:
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except FileNotFoundError as error:
        raise ValueError("there is no such file") from error
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ValueError("is not text in UTF-8") from error
    if path.suffix.lower() == ".csv":
        return _table(text)
    return _json(text) if path.suffix.lower() == ".json" else _toml(text)


def _json(text: str) -> Mapping[str, Any]:
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise ValueError("must be an object of JSON, {...} with settings by name")
    return values


def _toml(text: str) -> Mapping[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"is not TOML: {error}") from error


def _table(text: str) -> Mapping[str, Any]:
    """Settings of a table law from a CSV file whose first line names the columns."""
    rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if any(map(str.strip, row))]
    head = tuple(rows[0]) if rows else ()
    if head not in (_FACTOR, _MOMENTS, _TENSOR):
        expected = "; or ".join(", ".join(columns) for columns in (_FACTOR, _MOMENTS, _TENSOR))
        raise ValueError(f"the first line must name the columns {expected}; got {', '.join(head) or 'nothing'}")
    numbers = [_numbers(row, head, line) for line, row in enumerate(rows[1:], start=2)]
    values: list[Any] = [row[1] if head == _FACTOR else row[1:] for row in numbers]
    if head == _TENSOR:
        values = [_tensor(row[1:]) for row in numbers]
    return {"mode": TABLE, "times": [row[0] for row in numbers], "values": values}


def _numbers(row: list[str], head: tuple[str, ...], line: int) -> list[float]:
    if len(row) != len(head):
        raise ValueError(f"row {line} has {len(row)} columns, not {len(head)}")
    try:
        return [float(cell) for cell in row]
    except ValueError as error:
        raise ValueError(f"row {line} has an entry that is not a number: {error}") from error


def _tensor(entries: list[float]) -> list[list[float]]:
    tensor = [[0.0] * 3 for _ in range(3)]
    for (i, j), value in zip(_PLACES.values(), entries, strict=True):
        tensor[i][j] = tensor[j][i] = value
    return tensor
