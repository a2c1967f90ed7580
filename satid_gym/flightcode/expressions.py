"""Expressions of the core's functions in C, with what is known of them when the code is written."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from satid_gym.flightcode.c_types import (
    BOOL,
    DOUBLE,
    INT,
    Array,
    Record,
    Scalar,
    Tuple,
    Type,
    join,
    number,
    stored,
)
from satid_gym.flightcode.sources import Source, is_part

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
_FUNCTIONS: dict[Any, str] = {
    np.sqrt: "sqrt",
    np.exp: "exp",
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


class Expressions:
    """Translator of the expressions of one function.

    Attributes:
        variables: what is known of the local variables so far.
        prelude: statements that must come before the one whose expression is translated.
    """

    def __init__(self, program: Callee, source: Source) -> None:
        self.program, self.source = program, source
        self.variables: dict[str, Value] = {}
        self.prelude: list[str] = []
        self._temporaries = 0

    def temporary(self) -> str:
        """A name that no variable has."""
        self._temporaries += 1
        return f"t{self._temporaries}_"

    def value(self, node: ast.expr) -> Value:
        """Translate an expression.

        Raises:
            TranslationError: it is not part of the subset.
        """
        translate = getattr(self, f"_{type(node).__name__.lower()}", None)
        if translate is None:
            raise self.source.refuse(node, f"a {type(node).__name__}")
        return translate(node)

    def _constant(self, node: ast.Constant) -> Value:
        if not isinstance(node.value, int | float):
            raise self.source.refuse(node, "what is no number")
        return literal(node.value)

    def _name(self, node: ast.Name) -> Value:
        if node.id in self.source.stores:
            if node.id not in self.variables:
                raise self.source.refuse(node, "a variable that is read before it is assigned")
            return self.variables[node.id]
        return self._global(node)

    def _global(self, node: ast.expr) -> Value:
        found = self.source.known(node)
        if isinstance(found, tuple):
            parts = [literal(float(part)) for part in found]
            return self._tuple_of(parts)
        if not isinstance(found, int | float):
            raise self.source.refuse(node, "a global that is no number")
        return literal(found if isinstance(found, bool | float) else int(found))

    def _attribute(self, node: ast.Attribute) -> Value:
        if self.source.known(node) is not None:
            return self._global(node)
        base = self.value(node.value)
        if not isinstance(base.type, Record) or node.attr not in base.type.fields:
            raise self.source.refuse(node, "an attribute of what has none of that name")
        if node.attr in base.type.constants:
            return literal(base.type.constants[node.attr])
        kind = base.type.fields[node.attr]
        code = f"{base.code[1:]}.{node.attr}" if base.code.startswith("&") else f"{base.code}->{node.attr}"
        return Value(f"&{code}" if isinstance(kind, Record) else code, kind)

    def _subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            return self._length(node)
        base = self.value(node.value)
        if isinstance(base.type, Tuple):
            return self._part(base, node)
        if not isinstance(base.type, Array):
            raise self.source.refuse(node, "an index of what has no parts")
        if isinstance(node.slice, ast.Slice):
            return self._slice(base, base.type, node.slice)
        kind: Type = base.type
        code = base.code
        for index in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
            if not isinstance(kind, Array):
                raise self.source.refuse(node, "more indices than the array has")
            code, kind = f"{code}[{self.value(index).code}]", kind.row
        return Value(f"&{code}" if isinstance(kind, Record) else code, kind)

    def _length(self, node: ast.Subscript) -> Value:
        assert isinstance(node.value, ast.Attribute)
        kind, axis = self.value(node.value.value).type, self.value(node.slice).constant
        if not isinstance(kind, Array) or kind.shape[axis] is None:
            raise self.source.refuse(node, "a length that is not known")
        return literal(kind.shape[axis])

    def _part(self, base: Value, node: ast.Subscript) -> Value:
        assert isinstance(base.type, Tuple)
        index = self.value(node.slice)
        if base.type.is_uniform:
            return Value(f"{base.within(POSTFIX)}.v[{index.code}]", base.type.parts[0])
        if index.constant is None:
            raise self.source.refuse(node, "a variable index of a tuple of several types")
        return Value(f"{base.within(POSTFIX)}.f{index.constant}", base.type.parts[index.constant])

    def _slice(self, base: Value, kind: Array, node: ast.Slice) -> Value:
        low = literal(0) if node.lower is None else self.value(node.lower)
        high = literal(kind.shape[0]) if node.upper is None else self.value(node.upper)
        known = low.constant is not None and high.constant is not None
        length = max(high.constant - low.constant, 0) if known else None
        return Value(f"{base.code} + {low.within(PRODUCT)}", Array(kind.element, (length, *kind.shape[1:])), None, SUM)

    def _tuple(self, node: ast.Tuple) -> Value:
        return self._tuple_of([self.value(part) for part in node.elts])

    def _tuple_of(self, parts: list[Value]) -> Value:
        kind = Tuple(tuple(part.type for part in parts))
        codes = ", ".join(part.code for part in parts)
        name = self.program.use(kind)
        return Value(f"({name}){{{{{codes}}}}}" if kind.is_uniform else f"({name}){{{codes}}}", kind)

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
        return Value(f"-{of.within(POSTFIX)}", of.type, None, UNARY)

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
        return Value(f"SATID_COUNT({value.code})", DOUBLE)

    def _power(self, node: ast.AST, left: Value, right: Value) -> Value:
        if left.constant is not None and right.constant is not None:
            return literal(left.constant**right.constant)
        if right.constant == 2:
            name = {DOUBLE: "satid_square", INT: "satid_square_integer"}[left.type]  # type: ignore[index]
            return self.counted(Value(f"{name}({left.code})", left.type))
        if right.constant == 0.5:
            return self.counted(Value(f"sqrt({left.code})", DOUBLE))
        raise self.source.refuse(node, "a power other than 2 and 0.5")

    def _elementwise(self, node: ast.BinOp, left: Value, right: Value) -> Value:
        kind = left.type
        if left.type != right.type or not isinstance(kind, Array) or len(kind.shape) != 1 or None in kind.shape:
            raise self.source.refuse(node, "an operator on arrays of other shapes")
        name, of = self.temporary(), DOUBLE
        both = [Value(f"{side.within(POSTFIX)}[k]", of) for side in (left, right)]
        result = self.operate(node, node.op, *both)
        self.prelude.append(f"{stored(kind, name)};")
        self.prelude.append(f"for (int k = 0; k < {kind.shape[0]}; k++) {{")
        self.prelude += [f"    {name}[k] = {result.code};", "}"]
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

    def _call(self, node: ast.Call) -> Value:
        called = self.source.known(node.func)
        if node.keywords:
            raise self.source.refuse(node, "arguments by name")
        arguments = [self.value(argument) for argument in node.args]
        if is_part(called):
            name, kind = self.program.call(called, [argument.type for argument in arguments])
            return Value(f"{name}({', '.join(a.code for a in arguments)})", kind or Tuple(()))
        if called is np.empty:
            return Value(EMPTY, Array("double", (arguments[0].constant,)))
        if called not in _FUNCTIONS:
            raise self.source.refuse(node, "a call of this function")
        return self._number_call(node, called, arguments)

    def _number_call(self, node: ast.Call, called: Any, arguments: list[Value]) -> Value:
        name, kind = _FUNCTIONS[called], arguments[0].type
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
        return self.counted(Value(f"{name}({arguments[0].code})", DOUBLE))
