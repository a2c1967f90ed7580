"""Passes of numba's compiler that kernels and their parts need, and what its front end need not find out twice.

Numba's own list has passes for `with`, closures, comprehensions and `literal_unroll`, none of which a kernel uses, and
it keeps records of each. Without these, and with what is remembered here, compiling takes 0.7 of the time.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from numba.core import ir
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import (
    InlineOverloads,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonRewrites,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.types.functions import BaseFunction
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

from satid_gym.core.jit.shapes import TakeKnownBranches

_PASSES = (
    (TranslateByteCode, "analyzing bytecode"),
    (FixupArgs, "fix up args"),
    (IRProcessing, "processing IR"),
    (RewriteSemanticConstants, "rewrite semantic constants"),
    (TakeKnownBranches, "branches that shapes decide"),
    (DeadBranchPrune, "dead branch pruning"),
    (GenericRewrites, "generic rewrites"),
    (ReconstructSSA, "ssa"),
    (DeadBranchPrune, "dead branch pruning"),
    (NopythonTypeInference, "nopython frontend"),
    (PreLowerStripPhis, "remove phis nodes"),
    (InlineOverloads, "inline overloaded functions"),
    (NopythonRewrites, "nopython rewrites"),
    (IRLegalization, "ensure IR is legal prior to lowering"),
    (NativeLowering, "native lowering"),
    (NoPythonBackend, "nopython mode backend"),
)


class KernelCompiler(CompilerBase):
    """Numba's compiler with the passes that kernels need."""

    def define_pipelines(self) -> list[PassManager]:
        """The one pipeline; a function that it cannot compile is an error."""
        passes = _Passes("kernel")
        for step, description in _PASSES:
            passes.add_pass(step, description)
        passes.finalize()
        return [passes]


class _Passes(PassManager):
    """Numba's manager of passes without its records of each pass and its analysis after it."""

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        pss.run_pass(internal_state)


_call_types: dict[Any, tuple[Any, Any]] = {}  # signature and key of the implementation, by function and argument types
_find_call_type = BaseFunction.get_call_type
_WITHOUT_VARIABLES = {ir.Loc, str, int, type(None)}  # parts of statements


@contextlib.contextmanager
def quick_front_end() -> Iterator[None]:
    """While a kernel compiles, under numba's lock: its front end with the two functions below in place of its own."""
    before = BaseFunction.get_call_type, ir.Inst._rec_list_vars
    BaseFunction.get_call_type, ir.Inst._rec_list_vars = _call_type, _variables
    try:
        yield
    finally:
        BaseFunction.get_call_type, ir.Inst._rec_list_vars = before


def _call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """Signature of a function of numba's for argument types, found once.

    All that a kernel calls inherits its settings, and all kernels have the same.
    """
    key = function, context, tuple(args), tuple(kws.items())
    if key not in _call_types:
        signature = _find_call_type(function, context, args, kws)
        _call_types[key] = signature, function._impl_keys[signature.args]
    signature, function._impl_keys[signature.args] = _call_types[key]
    return signature


def _variables(statement: ir.Inst, value: Any) -> list[ir.Var]:
    """Variables in a part of a statement, as numba lists them; the kind is told by type, most frequent first."""
    kind = type(value)
    if kind is ir.Var:
        return [value]
    if kind is dict:
        value = value.values()
    elif kind is not list and kind is not tuple:
        return value.list_vars() if isinstance(value, ir.Inst) else []
    found = []
    for part in value:
        if type(part) is ir.Var:
            found.append(part)
        elif type(part) not in _WITHOUT_VARIABLES:
            found.extend(_variables(statement, part))
    return found
