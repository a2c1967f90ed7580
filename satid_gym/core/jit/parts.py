"""Parts: functions that numba compiles into kernels and leaves out of its own optimisation and linking.

By itself numba would optimise each function, with all that it calls, and make it executable, which takes longer than
compiling the kernels and serves nobody, for Python calls none of them. `python -m satid_gym.warmup` in an empty cache
took 0.51 of the time with these subclasses of numba's compiler that plain `njit` takes, and 0.36 with the passes of
`satid_gym.core.jit.passes` too (side by side on one machine). They rest on numba's internals, which is why
pyproject.toml caps its version.
"""

from __future__ import annotations

import functools
import gc
from collections.abc import Callable
from typing import Any

from llvmlite.binding import llvm_version_info
from numba import config, njit
from numba.core import sigutils
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import CPUDispatcher

from satid_gym.core.jit.passes import KernelCompiler, quick_front_end

_LLVM_MIN = 22  # that vectorises straight-line code rightly
_RARELY = 20_000, 50, 100  # objects, and collections of younger ones, between two collections
FLAGS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}


def inline(function: Callable[..., Any]) -> Any:
    """Compile a small function into whatever calls it."""
    return _part(function, _Inlined)


def inline_disjoint(function: Callable[..., Any]) -> Any:
    """Compile a small function, whose arguments share no memory, into whatever calls it.

    Nothing checks that they share none. Where the compiler knows, it computes with several numbers at once.
    """
    return _part(function, _InlinedDisjoint)


def outline(function: Callable[..., Any]) -> Any:
    """Compile a larger function once into every kernel that calls it."""
    return _part(function, _Outlined)


def outline_disjoint(function: Callable[..., Any]) -> Any:
    """Compile a larger function, whose arguments share no memory, once into every kernel that calls it."""
    return _part(function, _OutlinedDisjoint)


def _part(function: Callable[..., Any], pipeline: type[_Inlined]) -> Any:
    if config.DISABLE_JIT:
        return function
    flags = {"nopython": True, "boundscheck": None, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **FLAGS}
    return _Part(function, targetoptions={"forceinline": pipeline.inlines, **flags}, pipeline_class=pipeline)


class _Part(CPUDispatcher):
    """Compiler of a function for those that call it; called from Python, the function is compiled by itself."""

    def compile(self, sig: Any) -> Any:
        """Compile it for argument types, under the lock of the kernel that calls it."""
        args, _ = sigutils.normalize_signature(sig)
        if args not in self.overloads:
            with self._compiling_counter:
                self.add_overload(self._compiler.compile(args, None))
        return self.overloads[args].entry_point

    def add_overload(self, cres: Any) -> None:
        """Keep the compiled part where other functions find it, and Python does not."""
        self.overloads[tuple(cres.signature.args)] = cres

    @functools.cached_property
    def _by_itself(self) -> Any:
        return njit(**FLAGS)(self.py_func)

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        return self._by_itself


class _PartLibrary(JITCodeLibrary):
    """Code of a part and of all that it calls, as it came from the front end."""

    @property
    def codegen(self) -> Any:
        """Itself, where numba asks for what makes a function executable."""
        return self

    def set_env(self, name: str, env: Any) -> None:
        """Nothing to do: the environment is the kernel's."""

    def get_pointer_to_function(self, name: str) -> int:
        """No pointer: Python does not call it."""
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _OutlinedLibrary(_PartLibrary):
    """The same, with the part itself never to be inlined."""

    def add_ir_module(self, ir_module: Any) -> None:
        """Add the part's code."""
        for function in ir_module.functions:
            if not function.is_declaration:
                function.attributes.add("noinline")
        super().add_ir_module(ir_module)


class _Inlined(KernelCompiler):
    """Compiler that leaves a part as it comes from the front end."""

    library = _PartLibrary
    inlines, disjoint = True, False

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        """Compile it, to a library of its own kind."""
        self.state.flags.noalias = self.disjoint
        self.state.library = self.library(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)


class _Outlined(_Inlined):
    library = _OutlinedLibrary
    inlines = False


class _InlinedDisjoint(_Inlined):
    disjoint = True


class _OutlinedDisjoint(_Outlined):
    disjoint = True


class Vectorised(KernelCompiler):
    """Compiler of kernels, with straight-line code turned into operations on several numbers at once.

    Numba leaves that off, for some versions of LLVM got it wrong (its issue 8705): with LLVM 15 a filter breaks down in
    tests/test_filters.py. So it is on from the version on with which all tests pass.

    Python looks for garbage less often meanwhile: the front end makes millions of objects that live on, and to look
    through them again and again takes a twelfth of the time.
    """

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        """Compile it so, whatever numba's setting says for other people's functions."""
        before, config.SLP_VECTORIZE = config.SLP_VECTORIZE, int(llvm_version_info[0] >= _LLVM_MIN)
        thresholds = gc.get_threshold()
        gc.set_threshold(*_RARELY)
        try:
            with quick_front_end():
                return super().compile_extra(function)
        finally:
            config.SLP_VECTORIZE = before
            gc.set_threshold(*thresholds)
