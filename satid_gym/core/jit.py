"""How the core is compiled.

The few functions that Python calls are kernels, `@kernel`: they release the GIL and are cached on disk. What they call
is compiled into them: small functions, `@inline`, into whatever calls them, larger ones, `@outline`, once into each
kernel, since the compiler takes its time over every copy. Both are parts: by itself numba would optimise each, with all
that it calls, and make it executable, which takes longer than the kernels do and serves nobody.

Results must not depend on who compiled what first. LLVM may therefore not choose what to inline: a kernel from the
cache might be linked with functions that were compiled otherwise than its own, and the last bits would differ.

Numba's cache looks at the file of the kernel alone, so an edit of a function that the kernel calls would go unseen;
every kernel therefore closes over a fingerprint of all compiled source (core/ and control/), part of numba's cache key.

Numba also numbers the files of its cache, and two processes that compile at once may give one number to two kernels;
here a file is named by what it holds. And it numbers the types of records, and names compiled code by these numbers:
kernels for two record types that two processes compiled could have one name, and a third process that loads both would
call either for both. Here a record's number is made of what it holds.
A cache that is damaged, full or nowhere to be kept costs time, never a run: see
`KernelCache`.

With NUMBA_DISABLE_JIT=1 in the environment the same code runs as plain Python, some hundred times slower: for
debuggers, coverage and mutation testing.
"""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import config, njit, types
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher

_FLAGS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}


def _fingerprint() -> str:
    """Digest of the source files that hold compiled code, in name order."""
    digest = hashlib.sha256()
    for folder in ("core", "control"):
        for path in sorted((Path(__file__).parents[1] / folder).glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


SOURCE_FINGERPRINT = _fingerprint()


def _record_name(record: types.Record) -> tuple[str, tuple[str]]:
    """What a record type goes by in the names of compiled code, in every process."""
    return "Record", (hashlib.sha256(record.name.encode()).hexdigest()[:16],)


types.Record.mangling_args = property(_record_name)


def inline(function: Callable[..., Any]) -> Any:
    """Compile a small function into whatever calls it."""
    return _part(function, _Inlined)


def outline(function: Callable[..., Any]) -> Any:
    """Compile a larger function into every kernel that calls it, once."""
    return _part(function, _Outlined)


def _part(function: Callable[..., Any], pipeline: type[Compiler]) -> Any:
    if config.DISABLE_JIT:
        return function
    flags = {"nopython": True, "boundscheck": None, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **_FLAGS}
    return _Part(function, targetoptions={"forceinline": pipeline is _Inlined, **flags}, pipeline_class=pipeline)


class _Part(CPUDispatcher):
    """Compiles a function for those that call it. Python may call it as well: it is then compiled anew, as a whole."""

    def add_overload(self, cres: Any) -> None:
        """Keep the compiled part where other functions find it, and Python does not."""
        self.overloads[tuple(cres.signature.args)] = cres

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        return njit(**_FLAGS)(self.py_func)


class _PartLibrary(JITCodeLibrary):
    """Code of a part and of all it calls, as it came from the front end."""

    @property
    def codegen(self) -> Any:
        """Itself: who makes a function executable asks here."""
        return self

    def set_env(self, name: str, env: Any) -> None:
        """Nothing: the environment is that of the kernel."""

    def get_pointer_to_function(self, name: str) -> int:
        """None: Python does not call it."""
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _OutlinedLibrary(_PartLibrary):
    """The same, with the part itself never to be inlined."""

    def add_ir_module(self, ir_module: Any) -> None:
        """Take in the part's code."""
        for function in ir_module.functions:
            if not function.is_declaration:
                function.attributes.add("noinline")
        super().add_ir_module(ir_module)


class _Inlined(Compiler):
    """Numba's compiler, which leaves a part as it comes from the front end."""

    library = _PartLibrary

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        """Compile it, to a library of its own kind."""
        self.state.library = self.library(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)


class _Outlined(_Inlined):
    library = _OutlinedLibrary


def kernel(build: Callable[[str], Callable[..., Any]]) -> Any:
    """Compile and cache the function that `build(fingerprint)` returns.

    The returned function must name the fingerprint in its body, so that the fingerprint is one of its
    closure variables.
    """
    function = build(SOURCE_FINGERPRINT)
    if config.DISABLE_JIT:
        return _interpreted(function)
    compiled = njit(nogil=True, **_FLAGS)(function)
    compiled._cache = _cache_of(function)
    return compiled


def _cache_of(function: Callable[..., Any]) -> KernelCache | NoCache:
    """The cache of a kernel, or none where no folder for it can be written."""
    try:
        return KernelCache(function)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        return NoCache()


_SECONDS = 20  # that the core takes to compile
_said: set[str] = set()


def _say(topic: str, text: str) -> None:
    """Tell the user on standard error, once a process for each topic."""
    if topic not in _said:
        _said.add(topic)
        print(f"satid-gym: {text}", file=sys.stderr, flush=True)


class KernelCache(FunctionCache):
    """Numba's cache of a kernel. Says when a kernel has to be compiled, and why where it was compiled before."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file.__class__ = NamedByContent

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel as it was kept; None where it has to be compiled."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # what does not unpickle may raise anything
            _say_damaged(self._cache_file._index_path, error)
            found = None
        if found is None:
            _say(
                "compiling",
                f"compiling its core for this machine, about {_SECONDS} s, once; "
                "python -m satid_gym.warmup does it ahead of time",
            )
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel where that is possible; it can be called either way."""
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
    """Numba's files of a kernel's cache, each under a name of its own.

    Where two processes save at once one entry may be missing from the index: it is compiled again, no more.
    """

    def _load_index(self) -> dict[Any, str]:
        """What the cache holds: nothing where its index is damaged, so that the next save replaces it."""
        try:
            return super()._load_index()
        except Exception as error:  # what does not unpickle may raise anything
            _say_damaged(self._index_path, error)
            return {}

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
