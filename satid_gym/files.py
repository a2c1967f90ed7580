"""Files of results and policies, written atomically and read with clear errors."""

from __future__ import annotations

import contextlib
import json
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

_NUMBERS = re.compile(r"\[\n([-+.\deE,\s]+)\]")  # a list of numbers, each on a line of its own
PART = ".part"  # ending of the name of a file that is still being written


class DamagedFileError(ValueError):
    """Error for a file that is missing or has invalid content; the message says what to do."""


@contextlib.contextmanager
def replacing(path: Path, ending: str = PART) -> Iterator[Path]:
    """A temporary file next to `path` that takes its name atomically when the block ends without an error.

    A reader, a crash or a full disk never sees half a file: until the content is on disk, `path` is unchanged.

    Args:
        path: the file to write; its folder is made if missing.
        ending: of the temporary name, for a writer that chooses the format by it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=ending)
    os.close(descriptor)
    part = Path(name)
    try:
        yield part
        _sync(part)
        part.chmod(0o644)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)  # it is renamed already if Ctrl-C came that late
        raise
    if os.name == "posix":  # the new name survives a power cut only once the folder is on disk
        _sync(path.parent)


def _sync(path: Path) -> None:
    """Wait until a file or folder is on disk."""
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically; see `replacing`."""
    with replacing(path) as part:
        part.write_bytes(content)


def check_writable(folder: Path, *, stays: bool = True) -> None:
    """Check before long work that its results can be written to a folder, which is created if missing.

    Args:
        folder: where to write.
        stays: whether folders created here stay; if not, a command that fails leaves none, and the writers here create
            them again.

    Raises:
        OSError: they cannot.
    """
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        tempfile.TemporaryFile(dir=folder).close()
    finally:
        for one in () if stays else missing:
            one.rmdir()


def write_text(path: Path, text: str) -> None:
    """Write a text file, UTF-8, atomically."""
    write_bytes(path, text.encode())


def write_json(path: Path, values: Any) -> None:
    """Write JSON atomically, a list of numbers on one line; NaN and infinity are errors: other languages have none."""
    text = json.dumps(values, indent=1, allow_nan=False)
    write_text(path, _NUMBERS.sub(lambda numbers: f"[{' '.join(numbers[1].split())}]", text) + "\n")


def read_json(path: Path, remedy: str, *, keys: Iterable[str] = ()) -> dict[str, Any]:
    """Settings or results from a JSON file that holds an object.

    Args:
        path: the file.
        remedy: what to do if it is missing or damaged; ends the error message.
        keys: required names.

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
