"""Cells of a study that its file holds already, so that a command that was stopped goes on."""

from __future__ import annotations

import json
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

from satid_gym.files import read_json

GOES_ON = "what was flown is in the file; the same command goes on, without --again"
REMEDY = "give another --output, or --again to fly all again"
_HOW = ("output", "again", "merge", "ray")  # settings on which no result depends


def kept(
    file: Path, head: Mapping[str, Any], name: str, *, again: bool, mixed: Container[str] = ()
) -> list[dict[str, Any]]:
    """Cells of an earlier run of the same settings and revision; none where there is no file, or with `again`.

    Args:
        file: of the results.
        head: of the results to come, see `result_head`.
        name: of the cells in the file.
        again: whether all are flown again, and the file is replaced.
        mixed: settings that list what is flown. Where some are given, cells of other lists and revisions are kept too,
            and each names its revision.

    Raises:
        ValueError: the file holds other results, or those of code that was not committed; it is not replaced silently.
        DamagedFileError: it holds no results.
    """
    if not file.exists() or (again and not mixed):
        return []
    held = read_json(file, REMEDY, keys=("settings", "revision", name))
    asked = {key: value for key, value in head["settings"].items() if key not in _HOW and key not in mixed}
    if mixed:
        check_same(file, held["settings"], asked)
        return [{"revision": held["revision"], **cell} for cell in held[name]]
    now = head["revision"] if is_clean(head["revision"]) else None
    check_same(file, {**held["settings"], "revision": held["revision"]}, {**asked, "revision": now})
    return list(held[name])


def is_clean(revision: str) -> bool:
    """Whether a revision says which code has flown."""
    return revision != "unknown" and not revision.endswith("-dirty")


def check_same(what: object, held: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Refuse results that were flown with other values; those that the results do not tell are taken for the same.

    Raises:
        ValueError: a value differs; the message says which, and what to do.
    """
    asked = json.loads(json.dumps(asked))  # tuples as lists
    other = {name: held[name] for name, value in asked.items() if held.get(name, value) != value}
    if other:
        said = (f"other {k}" if isinstance(v, list | dict) else f"{k} = {v}" for k, v in other.items())
        raise ValueError(f"{what} was flown with {', '.join(said)}: {REMEDY}")
