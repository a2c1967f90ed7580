"""Expressions of the core's functions in C: variables, fields, elements, tuples and calls."""

from __future__ import annotations

import ast

import numpy as np

from satid_gym.flightcode.c_types import Array, Record, Tuple, Type
from satid_gym.flightcode.operators import EMPTY, FUNCTIONS, POSTFIX, PRODUCT, SUM, Callee, Operators, Value, literal
from satid_gym.flightcode.sources import Source, is_part


class Expressions(Operators):
    """Translator of the expressions of one function.

    Attributes:
        variables: what is known of the local variables so far.
    """

    def __init__(self, program: Callee, source: Source) -> None:
        super().__init__(program, source)
        self.variables: dict[str, Value] = {}

    def value(self, node: ast.expr) -> Value:
        """Translate an expression; see `Operators.value`."""
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
            return self._part_of_array(base, base.type, node.slice)
        kind: Type = base.type
        code = base.code
        for index in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
            if not isinstance(kind, Array):
                raise self.source.refuse(node, "more indices than the array has")
            code, kind = f"{code}[{self._within(index, kind.shape[0]).code}]", kind.row
        return Value(f"&{code}" if isinstance(kind, Record) else code, kind)

    def _length(self, node: ast.Subscript) -> Value:
        assert isinstance(node.value, ast.Attribute)
        kind, axis = self.value(node.value.value).type, self.value(node.slice).constant
        if not isinstance(kind, Array) or kind.shape[axis] is None:
            raise self.source.refuse(node, "a length that is not known")
        return literal(kind.shape[axis])

    def _part(self, base: Value, node: ast.Subscript) -> Value:
        assert isinstance(base.type, Tuple)
        index = self._within(node.slice, len(base.type.parts))
        if base.type.is_uniform:
            return Value(f"{base.within(POSTFIX)}.v[{index.code}]", base.type.parts[0])
        if index.constant is None:
            raise self.source.refuse(node, "a variable index of a tuple of several types")
        return Value(f"{base.within(POSTFIX)}.f{index.constant}", base.type.parts[index.constant])

    def _within(self, node: ast.expr, length: int | None) -> Value:
        """An index; one that is known is counted from the start, and refused where nothing is."""
        index = self.value(node)
        if index.constant is None:
            return index
        if index.constant < 0 and length is not None:
            index = literal(index.constant + length)
        if index.constant < 0 or (length is not None and index.constant >= length):
            raise self.source.refuse(node, "an index beyond what is there")
        return index

    def _part_of_array(self, base: Value, kind: Array, node: ast.Slice) -> Value:
        low = literal(0) if node.lower is None else self.value(node.lower)
        high = literal(kind.shape[0]) if node.upper is None else self.value(node.upper)
        beyond = kind.shape[0] is not None and (high.constant or 0) > kind.shape[0]
        if node.step is not None or beyond or any((end.constant or 0) < 0 for end in (low, high)):
            raise self.source.refuse(node, "a part of an array by steps, from its end, or beyond it")
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

    def _call(self, node: ast.Call) -> Value:
        called = self.source.known(node.func)
        if node.keywords:
            raise self.source.refuse(node, "arguments by name")
        if called is np.empty:
            (size,) = node.args
            lengths = [self.value(length).constant for length in (size.elts if isinstance(size, ast.Tuple) else [size])]
            return Value(EMPTY, Array("double", tuple(lengths)))
        arguments = [self.value(argument) for argument in node.args]
        if is_part(called):
            name, kind = self.program.call(called, [argument.type for argument in arguments])
            return Value(f"{name}({', '.join(a.code for a in arguments)})", kind or Tuple(()))
        if called not in FUNCTIONS:
            raise self.source.refuse(node, "a call of this function")
        return self._number_call(node, called, arguments)
