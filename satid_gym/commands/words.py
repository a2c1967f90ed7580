"""Words of a command line as pages and records show them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path


def as_typed(arguments: Sequence[str]) -> str:
    """The command, with the names alone of files that were given by a path from the root."""
    return shlex.join(["satid", *map(_without_folders, arguments)])


def _without_folders(word: str) -> str:
    option, sign, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + sign + (Path(value).name if Path(value).is_absolute() else value)
