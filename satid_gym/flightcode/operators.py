"""Operators of the core's expressions in C, on values of which some are known when the code is written."""

from __future__ import annotations

import ast
import operator
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from satid_gym.flightcode.c_types import BOOL, DOUBLE, INT, Array, Scalar, Tuple, Type, join, number, stored
from satid_gym.flightcode.sources import Source

EMPTY = ""  # code of an array without values yet
CONDITION, OR, AND, EQUAL, LESS, SUM, PRODUCT, UNARY, POSTFIX = range(9)
_BINARY: dict[type[ast.operator], tuple[str, int, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", SUM, operator.add),
    ast.Sub: ("-", SUM, operator.sub),
    ast.Mult: ("*", PRODUCT, operator.mul),
    ast.Div: ("/", PRODUCT, operator.truediv),
}
_FLOOR: dict[type[ast.operator], tuple[str, Callable[[int, int], int]]] = {
    ast.FloorDiv: ("satid_floor_divide", operator.floordiv),
    ast.Mod: ("satid_modulo", operator.mod),
}
_COMPARE: dict[type[ast.cmpop], tuple[str, int, Callable[[Any, Any], bool]]] = {
    ast.Eq: ("==", EQUAL, operator.eq),
    ast.NotEq: ("!=", EQUAL, operator.ne),
    ast.Lt: ("<", LESS, operator.lt),
    ast.LtE: ("<=", LESS, operator.le),
    ast.Gt: (">", LESS, operator.gt),
    ast.GtE: (">=", LESS, operator.ge),
}
FUNCTIONS: dict[Any, str] = {
    np.sqrt: "sqrt",
    np.exp: "exp",
    np.sin: "sin",
    np.cos: "cos",
    np.arctan2: "atan2",
    np.hypot: "hypot",
    np.log: "log",
    np.log10: "log10",
    np.ceil: "ceil",
    np.sign: "satid_sign",
    abs: "fabs",
    min: "satid_min",
    max: "satid_max",
    np.float64: "(double)",
    np.int64: "satid_integer",
}


@dataclass(frozen=True)
class Value:
    """Expression in C, its type, its value where that is known, and how tightly its last operator binds."""

    code: str
    type: Type
    constant: Any = None
    rank: int = POSTFIX

    def within(self, rank: int) -> str:
        """The code, in parentheses where its operator binds less than `rank`."""
        return self.code if self.rank >= rank else f"({self.code})"


class Callee(Protocol):
    """Program that the functions are parts of."""

    counting: bool

    def call(self, function: Callable[..., Any], arguments: list[Type]) -> tuple[str, Type | None]:
        """Name and result of a function for arguments of these types."""

    def use(self, kind: Tuple) -> str:
        """Name of a tuple's struct, which is then defined."""


def literal(value: Any) -> Value:
    """A number that is known."""
    kind = BOOL if isinstance(value, bool) else INT if isinstance(value, int) else DOUBLE
    return Value(number(value), kind, value, UNARY if value < 0 else POSTFIX)


class Operators(ABC):
    """Translator of the operators in one function.

    Attributes:
        prelude: statements that must come before the one whose expression is translated.
    """

    def __init__(self, program: Callee, source: Source) -> None:
        self.program, self.source = program, source
        self.prelude: list[str] = []
        self._temporaries = 0

    @abstractmethod
    def value(self, node: ast.expr) -> Value:
        """Translate an expression.

        Raises:
            TranslationError: it is not part of the subset.
        """

    def temporary(self) -> str:
        """A name that no variable has."""
        self._temporaries += 1
        return f"t{self._temporaries}_"

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        of = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return (
                literal(not of.constant)
                if of.constant is not None
                else Value(f"!{of.within(UNARY)}", BOOL, None, UNARY)
            )
        if not isinstance(node.op, ast.USub):
            raise self.source.refuse(node, f"a {type(node.op).__name__}")
        if of.constant is not None:
            return literal(-of.constant)
        return Value(f"-{of.within(POSTFIX)}", INT if of.type == BOOL else of.type, None, UNARY)

    def _binop(self, node: ast.BinOp) -> Value:
        left, right = self.value(node.left), self.value(node.right)
        if isinstance(left.type, Array):
            return self._elementwise(node, left, right)
        return self.operate(node, node.op, left, right)

    def operate(self, node: ast.AST, op: ast.operator, left: Value, right: Value) -> Value:
        """Result of a binary operator on two numbers."""
        if not (isinstance(left.type, Scalar) and isinstance(right.type, Scalar)):
            raise self.source.refuse(node, "an operator on what is no number")
        known = left.constant is not None and right.constant is not None
        integers = DOUBLE not in (left.type, right.type)
        if isinstance(op, ast.Pow):
            return self._power(node, left, right)
        if type(op) in _FLOOR and integers:
            name, operation = _FLOOR[type(op)]
            if known:
                return literal(operation(left.constant, right.constant))
            return Value(f"{name}({left.code}, {right.code})", INT)
        if type(op) not in _BINARY:
            raise self.source.refuse(node, f"a {type(op).__name__}")
        sign, rank, operation = _BINARY[type(op)]
        if known and not (sign == "/" and right.constant == 0):
            return literal(operation(left.constant, right.constant))
        before = f"(double){left.within(UNARY)}" if sign == "/" and integers else left.within(rank)
        kind = INT if integers and sign != "/" else DOUBLE
        return self.counted(Value(f"{before} {sign} {right.within(rank + 1)}", kind, None, rank))

    def counted(self, value: Value) -> Value:
        """The value, which in a program that counts its operations adds one to them."""
        if not self.program.counting or value.type != DOUBLE:
            return value
        return Value(f"satid_counted({value.code})", DOUBLE)

    def _power(self, node: ast.AST, left: Value, right: Value) -> Value:
        if left.constant is not None and right.constant is not None:
            return literal(left.constant**right.constant)
        if right.constant == 2:
            if left.type != DOUBLE:
                raise self.source.refuse(node, "the square of an integer")
            return self.counted(Value(f"satid_square({left.code})", DOUBLE))
        if right.constant == 0.5:
            return self.counted(Value(f"sqrt({left.code})", DOUBLE))
        raise self.source.refuse(node, "a power other than 2 and 0.5")

    def _elementwise(self, node: ast.BinOp, left: Value, right: Value) -> Value:
        kind = left.type
        if left.type != right.type or not isinstance(kind, Array) or len(kind.shape) != 1 or None in kind.shape:
            raise self.source.refuse(node, "an operator on arrays of other shapes")
        name, k = self.temporary(), self.temporary()
        both = [Value(f"{side.within(POSTFIX)}[{k}]", DOUBLE) for side in (left, right)]
        result = self.operate(node, node.op, *both)
        self.prelude.append(f"{stored(kind, name)};")
        self.prelude.append(f"for (int {k} = 0; {k} < {kind.shape[0]}; {k}++) {{")
        self.prelude += [f"    {name}[{k}] = {result.code};", "}"]
        return Value(name, kind)

    def _compare(self, node: ast.Compare) -> Value:
        if len(node.ops) != 1 or type(node.ops[0]) not in _COMPARE:
            raise self.source.refuse(node, "such a comparison")
        left, right = self.value(node.left), self.value(node.comparators[0])
        sign, rank, operation = _COMPARE[type(node.ops[0])]
        if left.constant is not None and right.constant is not None:
            return literal(bool(operation(left.constant, right.constant)))
        return Value(f"{left.within(SUM)} {sign} {right.within(SUM)}", BOOL, None, rank)

    def _boolop(self, node: ast.BoolOp) -> Value:
        absorbing, sign = (False, "&&") if isinstance(node.op, ast.And) else (True, "||")
        parts: list[Value] = []
        for operand in node.values:
            part = self.value(operand)
            if part.type != BOOL:
                raise self.source.refuse(operand, "a condition that is no comparison")
            if part.constant is None:
                parts.append(part)
            elif part.constant == absorbing:
                if not parts:
                    return literal(absorbing)
                parts.append(part)
                break
        if len(parts) < 2:
            return parts[0] if parts else literal(not absorbing)
        return Value(f" {sign} ".join(part.within(EQUAL) for part in parts), BOOL, None, AND if sign == "&&" else OR)

    def _ifexp(self, node: ast.IfExp) -> Value:
        test = self.value(node.test)
        if test.constant is not None:
            return self.value(node.body if test.constant else node.orelse)
        one, other = self.value(node.body), self.value(node.orelse)
        kind = join(one.type, other.type, self.source.where(node))
        return Value(f"{test.within(OR)} ? {one.within(OR)} : {other.within(OR)}", kind, None, CONDITION)

    def _number_call(self, node: ast.Call, called: Any, arguments: list[Value]) -> Value:
        name, kind = FUNCTIONS[called], arguments[0].type
        if all(argument.constant is not None for argument in arguments) and called is not np.int64:
            found = called(*(argument.constant for argument in arguments))
            return literal(found.item() if isinstance(found, np.generic) else found)
        if called in (min, max):
            kind = arguments[0].type
            for argument in arguments[1:]:
                kind = join(kind, argument.type, self.source.where(node))
            name += "_integer" if kind == INT else ""
            code = arguments[0].code
            for argument in arguments[1:]:
                code = f"{name}({code}, {argument.code})"
            return Value(code, kind)
        if called is np.float64:
            return Value(f"(double){arguments[0].within(UNARY)}", DOUBLE, None, UNARY)
        if called is np.int64:
            return Value(f"{name}({arguments[0].code})", INT)
        if kind != DOUBLE:
            raise self.source.refuse(node, "this function of an integer")
        return self.counted(Value(f"{name}({', '.join(argument.code for argument in arguments)})", DOUBLE))
