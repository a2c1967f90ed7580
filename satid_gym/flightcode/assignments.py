"""Assignments of the core's functions in C, and the types that local variables get by them."""

from __future__ import annotations

import ast

from satid_gym.flightcode.c_types import DOUBLE, INT, Array, Record, Scalar, Tuple, Type, c_name, declared, join, stored
from satid_gym.flightcode.expressions import Expressions
from satid_gym.flightcode.operators import EMPTY, POSTFIX, Callee, Value
from satid_gym.flightcode.sources import Source, loaded

_AUGMENTED = {ast.Add: "+=", ast.Sub: "-=", ast.Mult: "*=", ast.Div: "/="}


class Assignments(Expressions):
    """Translator of the assignments in one function."""

    def __init__(self, program: Callee, source: Source) -> None:
        super().__init__(program, source)
        self._types: dict[str, Type] = {}
        self._homes: dict[str, list[ast.stmt]] = {}
        self._lines: list[str] = []
        self._declared: set[str] = set()
        self._hoisted: set[str] = set()  # declared at the function's top
        self._arrays: set[str] = set()  # that are the function's own

    def _declaration(self, name: str) -> str:
        kind = self._types[name]
        return stored(kind, name) if name in self._arrays else declared(kind, name)

    def _say(self, depth: int, line: str) -> None:
        self._lines += ["    " * depth + text for text in [*self.prelude, line]]
        self.prelude = []

    def _augment(self, node: ast.AugAssign, depth: int) -> None:
        value = self.value(node.value)
        before = self.value(loaded(node.target))
        result = self.operate(node, node.op, before, value)
        if isinstance(node.target, ast.Name):
            if node.target.id in self.source.loops:
                raise self.source.refuse(node, "an assignment to a loop's variable")
            self._settle(node.target.id, result.type, node)
        elif before.type == INT and result.type != INT:
            raise self.source.refuse(node, "an integer that becomes another number")
        if type(node.op) not in _AUGMENTED:
            raise self.source.refuse(node, f"an assignment by {type(node.op).__name__}")
        if self.program.counting and result.type == DOUBLE:
            self._say(depth, f"{before.code} = {result.code};")
        else:
            self._say(depth, f"{before.code} {_AUGMENTED[type(node.op)]} {value.code};")

    def _assign(self, node: ast.Assign, block: list[ast.stmt], depth: int) -> None:
        if len(node.targets) > 1:
            value = self.value(node.value)
            if value.constant is None and not value.code.isidentifier():
                value = self._kept(value, depth)
            for target in node.targets:
                self._store(target, value, block, depth)
            return
        (target,) = node.targets
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            self._assign_each(target, node.value, block, depth)
        else:
            self._store(target, self.value(node.value), block, depth)

    def _assign_each(self, target: ast.Tuple, value: ast.Tuple, block: list[ast.stmt], depth: int) -> None:
        """A tuple of targets from a tuple of values, all of which are found before the first is stored."""
        values = [self.value(part) for part in value.elts]
        for i, found in enumerate(values[1:], 1):
            if found.constant is None and any(self._touches(t, value.elts[i]) for t in target.elts[:i]):
                values[i] = self._kept(found, depth)
        for one, found in zip(target.elts, values, strict=True):
            self._store(one, found, block, depth)

    def _touches(self, target: ast.expr, value: ast.expr) -> bool:
        """Whether to store the target may change the value."""
        names = {node.id for node in ast.walk(value) if isinstance(node, ast.Name)}
        if isinstance(target, ast.Name):
            return target.id in names
        kinds = [self.variables[name].type for name in names & set(self.variables)]
        calls = any(isinstance(node, ast.Call) for node in ast.walk(value))
        return calls or any(isinstance(kind, Array | Record) for kind in kinds) or isinstance(target, ast.Tuple)

    def _kept(self, value: Value, depth: int) -> Value:
        """The value in a variable of its own."""
        name = self.temporary()
        self._say(
            depth, f"{'const ' * isinstance(value.type, Scalar | Tuple)}{declared(value.type, name)} = {value.code};"
        )
        return Value(name, value.type)

    def _store(self, target: ast.expr, value: Value, block: list[ast.stmt], depth: int) -> None:
        if isinstance(target, ast.Tuple):
            for i, part in enumerate(target.elts):
                if i == 0 and not value.code.isidentifier():
                    value = self._kept(value, depth)
                self._store(part, self._part_of(value, i, target), block, depth)
        elif isinstance(target, ast.Name):
            self._store_name(target, value, block, depth)
        elif isinstance(target, ast.Attribute | ast.Subscript):
            self._store_place(target, value, depth)
        else:
            raise self.source.refuse(target, "such a target")

    def _part_of(self, value: Value, i: int, node: ast.Tuple) -> Value:
        kind = value.type
        if isinstance(kind, Tuple) and len(kind.parts) == len(node.elts):
            return Value(f"{value.code}.v[{i}]" if kind.is_uniform else f"{value.code}.f{i}", kind.parts[i])
        if isinstance(kind, Array) and kind.shape[0] == len(node.elts):
            return Value(f"{value.within(POSTFIX)}[{i}]", kind.row)
        raise self.source.refuse(node, "an assignment of this number of parts")

    def _store_place(self, target: ast.expr, value: Value, depth: int) -> None:
        place = self.value(loaded(target))
        if not isinstance(place.type, Scalar) or not isinstance(value.type, Scalar):
            raise self.source.refuse(target, "an assignment of what is no number")
        cast = ""
        if place.type == INT and value.type == DOUBLE:
            cast = "(int32_t)"
        elif isinstance(target, ast.Subscript) and self._element(target) == "float":
            cast = "(float)"
        self._say(depth, f"{place.code} = {cast}{value.within(POSTFIX) if cast else value.code};")

    def _element(self, target: ast.Subscript) -> str:
        base = self.value(loaded(target.value)).type
        return base.element if isinstance(base, Array) and isinstance(base.element, str) else ""

    def _settle(self, name: str, kind: Type, node: ast.AST) -> None:
        self._types[name] = join(self._types.get(name), kind, self.source.where(node))

    def _variant(self, name: str, kind: Type) -> str:
        """Name in C of a variable that takes a value of this type: another where it has held another kind of value."""
        before = self._types.get(name, kind)
        alike = type(before) is type(kind) and (not isinstance(kind, Tuple) or before == kind)
        return name if alike else f"{name}_{c_name(kind)}"

    def _store_name(self, target: ast.Name, value: Value, block: list[ast.stmt], depth: int) -> None:
        name = self._variant(target.id, value.type)
        if value.code == EMPTY:
            self._arrays.add(name)
        self._settle(name, value.type, target)
        if value.constant is not None and self.source.stores[target.id] == 1:
            self.variables[target.id] = value
            return
        self.variables[target.id] = Value(name, self._types[name])
        code = f"{name} = {value.code};"
        if name not in self._declared and self._homes.get(name) is block:
            self._declared.add(name)
            lead = self._declaration(name)
            self._say(depth, f"{lead};" if name in self._arrays else f"{lead} = {value.code};")
            return
        if name not in self._declared:
            self._declared.add(name)
            self._hoisted.add(name)
        if name not in self._arrays:
            self._say(depth, code)
