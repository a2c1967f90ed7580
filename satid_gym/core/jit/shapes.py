"""Branches that the shapes of records decide, taken before numba infers types.

A filter without panels holds arrays of no rows for them, and `if modes.coupling.shape[0] > 0` is false whatever its
numbers are. LLVM drops such a branch in the end; here it is dropped first, so that nothing in it is compiled. Without
this, `python -m satid_gym.warmup` in an empty cache takes 1.4 times as long (`--scenario flex`: 1.15 times).
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

from numba.core import ir, types
from numba.core.analysis import compute_cfg_from_blocks
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.consts import ConstantInference
from numba.core.ir_utils import build_definitions

_COMPARISONS = {operator.lt, operator.le, operator.eq, operator.ne, operator.gt, operator.ge}


class _Unknown(Exception):
    """What only the numbers tell, at run time."""


@register_pass(mutates_CFG=True, analysis_only=False)
class TakeKnownBranches(FunctionPass):
    """Replace a branch whose condition the shapes decide by a jump, and drop the blocks that nothing leads to."""

    _name = "take_known_branches"

    def __init__(self) -> None:
        super().__init__()  # abstract in numba's class

    def run_pass(self, state: Any) -> bool:
        """Change the function of a compiler's state; whether it has changed."""
        changed = False
        while _take_known_branches(state.func_ir, state.args):  # without a dead block, more may be known
            changed = True
        return changed


def _take_known_branches(function: ir.FunctionIR, arguments: Sequence[types.Type]) -> bool:
    """Take the branches whose conditions are known now; whether there was any."""
    shapes, changed = _Shapes(function, arguments), False
    for block in function.blocks.values():
        last = block.body[-1]
        if isinstance(last, ir.Branch):
            try:
                taken = shapes.value_of(last.cond)
            except _Unknown:
                continue
            if isinstance(taken, int):
                block.body[-1] = ir.Jump(last.truebr if taken else last.falsebr, loc=last.loc)
                changed = True
    if changed:
        for dead in compute_cfg_from_blocks(function.blocks).dead_nodes():
            del function.blocks[dead]
        function._definitions = build_definitions(function.blocks)
        function._consts = ConstantInference(function)
    return changed


class _Shapes:
    """Values in a function that follow from its constants and the types of its arguments."""

    def __init__(self, function: ir.FunctionIR, arguments: Sequence[types.Type]) -> None:
        self._definitions, self._arguments = function._definitions, arguments

    def value_of(self, variable: ir.Var) -> Any:
        """Number of a variable, tuple of numbers, or type of a record or array; _Unknown where that may vary."""
        definitions = self._definitions.get(variable.name, ())
        if len(definitions) != 1:
            raise _Unknown
        return self._evaluate(definitions[0])

    def _evaluate(self, value: Any) -> Any:
        if isinstance(value, ir.Var):
            return self.value_of(value)
        if isinstance(value, ir.Arg):
            return self._arguments[value.index]
        if isinstance(value, ir.Const | ir.Global | ir.FreeVar):
            return value.value
        if isinstance(value, ir.Expr):
            return self._evaluate_expression(value)
        raise _Unknown

    def _evaluate_expression(self, value: ir.Expr) -> Any:
        if value.op == "getattr":
            return _part_of(self.value_of(value.value), value.attr)
        if value.op == "getitem":
            shape, index = self.value_of(value.value), self.value_of(value.index)
            if isinstance(shape, tuple) and isinstance(index, int):
                return shape[index]
        if value.op == "binop" and value.fn in _COMPARISONS:
            left, right = self.value_of(value.lhs), self.value_of(value.rhs)
            if isinstance(left, int) and isinstance(right, int):
                return value.fn(left, right)
        if value.op == "call" and self.value_of(value.func) is bool:
            (argument,) = value.args
            return self.value_of(argument)
        raise _Unknown


def _part_of(owner: Any, name: str) -> Any:
    """Type of a record's field, or shape of an array in a record."""
    if isinstance(owner, types.Record) and name in owner.fields:
        return owner.fields[name].type
    if isinstance(owner, types.NestedArray) and name == "shape":
        return owner.shape
    raise _Unknown
