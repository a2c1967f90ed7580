"""Files of results and policies: written atomically, read with errors that say what to do."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

PART = ".part"  # how the name ends of a file that is still being written


class DamagedFileError(ValueError):
    """A file is missing or not what it should be; the message says what to do."""


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file so that a reader, a crash or a full disk never meets half of it: the old one stays till then."""
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, part = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=PART)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(part, 0o644)
        os.replace(part, path)
    except BaseException:
        Path(part).unlink(missing_ok=True)  # it has its name already where Ctrl-C came that late
        raise
    if os.name == "posix":  # the new name outlasts a power cut only once the folder is on disk
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def check_writable(folder: Path) -> None:
    """Find out before long work, not after it, whether its results can be written.

    Raises:
        OSError: they cannot.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()


def write_text(path: Path, text: str) -> None:
    """Write a file of text as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_json(path: Path, values: Any) -> None:
    """Write JSON; NaN and infinity are errors, for no other language reads them."""
    write_text(path, json.dumps(values, indent=1, allow_nan=False) + "\n")


def read_json(path: Path, remedy: str, *, keys: Iterable[str] = ()) -> dict[str, Any]:
    """Read an object of JSON.

    Args:
        path: the file.
        remedy: what to do where it is missing or damaged; ends the error's line.
        keys: names it must have.

    Raises:
        DamagedFileError: it is missing, not JSON, not an object, or without one of the keys.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DamagedFileError(f"{path} is missing: {remedy}") from error
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(f"{path} is not JSON ({error}): {remedy}") from error
    missing = [key for key in keys if not isinstance(values, dict) or key not in values]
    if missing or not isinstance(values, dict):
        raise DamagedFileError(f"{path} holds no {', '.join(missing) or 'object'}: {remedy}")
    return values
