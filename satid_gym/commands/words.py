"""Words of a command line as pages and records show them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path


def as_typed(arguments: Sequence[str]) -> str:
    """The command, with the names alone of files that were given by a path from the root."""
    return shlex.join(["satid", *(Path(word).name if Path(word).is_absolute() else word for word in arguments)])
