"""How the core is compiled.

Small functions carry `@inline`: they are compiled into whatever calls them. The few kernels that Python
calls carry `@kernel`: they release the GIL and are cached on disk. Numba's cache looks at the file of the
kernel alone, so an edit of a function that the kernel calls would go unseen; every kernel therefore closes
over a fingerprint of the whole core's source, which is part of numba's cache key.

Numba also numbers the files of its cache, and two processes that compile at once may give one number to two kernels;
here a file is named by what it holds.

With NUMBA_DISABLE_JIT=1 in the environment the same code runs as plain Python, some hundred times slower: for
debuggers, coverage and mutation testing.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import config, njit
from numba.core.caching import IndexDataCacheFile

_FLAGS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}


def _fingerprint() -> str:
    """Digest of the core's source files, in name order."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


SOURCE_FINGERPRINT = _fingerprint()


def inline(function: Callable[..., Any]) -> Any:
    """Compile a small pure function; LLVM has to inline it into the kernel that calls it.

    Left to choose, it keeps some as functions, and a kernel from the cache is then linked with others than one that
    was just compiled: results would differ in their last bit.
    """
    return njit(forceinline=True, **_FLAGS)(function)


def kernel(build: Callable[[str], Callable[..., Any]]) -> Any:
    """Compile and cache the function that `build(fingerprint)` returns.

    The returned function must name the fingerprint in its body, so that the fingerprint is one of its
    closure variables.
    """
    function = build(SOURCE_FINGERPRINT)
    if config.DISABLE_JIT:
        return _interpreted(function)
    compiled = njit(nogil=True, cache=True, **_FLAGS)(function)
    compiled._cache._cache_file.__class__ = NamedByContent
    return compiled


class NamedByContent(IndexDataCacheFile):
    """Numba's files of a kernel's cache, each under a name of its own.

    Where two processes save at once one entry may be missing from the index: it is compiled again, no more.
    """

    def save(self, key: Any, data: Any) -> None:
        """Write the compiled code first and then the index that names it."""
        overloads = self._load_index()
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        overloads[key] = f"{self._index_name.removesuffix('.nbi')}.{digest}.nbc"
        self._save_data(overloads[key], data)
        self._save_index(overloads)


def _interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel as plain Python: fields are attributes, words wrap and divisions by zero pass, as compiled."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*map(_with_attributes, arguments))

    return call


def _with_attributes(argument: Any) -> Any:
    """The same memory, with the fields of its records as attributes."""
    if isinstance(argument, tuple):
        return tuple(map(_with_attributes, argument))
    if isinstance(argument, np.ndarray) and argument.dtype.names:
        return argument.view(_record_type(argument.dtype))
    return argument


@functools.cache
def _record_type(dtype: np.dtype) -> np.dtype:
    """The dtype with a scalar whose fields are attributes; numpy's own record hides those named as methods (mean)."""
    fields = {name: _field(name) for name in dtype.names or ()}
    return np.dtype((type("Record", (np.void,), fields), dtype))


def _field(name: str) -> property:
    return property(lambda record: record[name], lambda record, value: record.__setitem__(name, value))
