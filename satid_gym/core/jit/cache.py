"""Cache of compiled kernels on disk, safe among processes that compile at once.

Numba's cache looks at the size and the time of the kernel's file alone, so an edit of a function that the kernel calls
would go unseen: here the stamp of the source is a digest of that file and of all compiled source (core/ and control/).
So compiled kernels can be taken along to a new checkout or installation of the same source.

Numba numbers the files of its cache, and two processes that compile at once may give one number to two kernels: here a
file is named by its content. Numba also numbers the types of records, and names compiled code by these numbers, so
that kernels for two record types that two processes compiled could have one name, and a third process that loads both
would call either for both: here a record's number is a digest of its fields.

A cache that is damaged, full or in a folder that cannot be written costs time, never a run.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import types
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache


def _fingerprint() -> str:
    """Digest of the source files that hold compiled code, in name order."""
    digest = hashlib.sha256()
    for folder in ("core", "control"):
        for path in sorted((Path(__file__).parents[2] / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


SOURCE_FINGERPRINT = _fingerprint()


def _record_name(record: types.Record) -> tuple[str, tuple[str]]:
    """Name of a record type in compiled code, the same in every process."""
    return "Record", (hashlib.sha256(record.name.encode()).hexdigest()[:16],)


types.Record.mangling_args = property(_record_name)


def cache_of(function: Callable[..., Any]) -> KernelCache | NoCache:
    """Cache of a kernel; one that keeps nothing where no folder for it can be written."""
    try:
        return KernelCache(function)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        return NoCache()


_SECONDS = 50  # that the core takes to compile
_said: set[str] = set()


def _say(topic: str, text: str) -> None:
    """Tell the user on standard error, once a process for each topic."""
    if topic not in _said:
        _said.add(topic)
        print(f"satid-gym: {text}", file=sys.stderr, flush=True)


class KernelCache(FunctionCache):
    """Numba's cache of a kernel, which says when a kernel has to be compiled, and why if it was compiled before."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file.__class__ = NamedByContent
        own = hashlib.sha256(Path(inspect.getfile(function)).read_bytes()).hexdigest()
        self._cache_file._source_stamp = (own, SOURCE_FINGERPRINT)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel from the cache; None where it has to be compiled."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # what does not unpickle may raise anything
            _say_damaged(self._cache_file._index_path, error)
            found = None
        if found is None:
            _say(
                "compiling",
                f"compiling its core for this kind of satellite, about {_SECONDS} s, once; "
                "python -m satid_gym.warmup does it ahead of time",
            )
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a compiled kernel to the cache where that is possible; it can be called either way."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say(
                "unwritten",
                f"what it compiled cannot be kept in {self.cache_path} ({error.strerror or error}), so the next "
                "process compiles it again: make room there, or set NUMBA_CACHE_DIR to a folder that can be written",
            )


class NoCache(NullCache):
    """In place of a kernel's cache where no folder for it can be written."""

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """None: it has to be compiled."""
        _say(
            "compiling",
            f"compiling its core for this machine, about {_SECONDS} s, in every process: neither the installed package "
            "nor the user's cache folder can be written; set NUMBA_CACHE_DIR to a folder that can",
        )


def _say_damaged(path: str, error: Exception) -> None:
    _say(path, f"{path} or what it names is damaged ({type(error).__name__}: {error}); compiling that kernel again")


class NamedByContent(IndexDataCacheFile):
    """Files of a kernel's cache, each named by its content.

    Where two processes save at once, one entry may be missing from the index and is compiled again.
    """

    def _load_index(self) -> dict[Any, str]:
        """Index of the cache; empty where it is damaged, so that the next save replaces it."""
        try:
            return super()._load_index()
        except Exception as error:  # what does not unpickle may raise anything
            _say_damaged(self._index_path, error)
            return {}

    def save(self, key: Any, data: Any) -> None:
        """Write the compiled code first and then the index that names it."""
        overloads = self._load_index()
        digest = hashlib.sha256(repr((SOURCE_FINGERPRINT, key)).encode()).hexdigest()[:16]
        overloads[key] = f"{self._index_name.removesuffix('.nbi')}.{digest}.nbc"
        self._save_data(overloads[key], data)
        self._save_index(overloads)
