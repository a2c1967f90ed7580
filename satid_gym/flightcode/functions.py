"""Functions of the core in C: statements, the types of local variables, and where these are declared."""

from __future__ import annotations

import ast
import re

from satid_gym.flightcode.c_types import (
    DOUBLE,
    INT,
    Array,
    Record,
    Scalar,
    Tuple,
    Type,
    c_name,
    declared,
    join,
    stored,
)
from satid_gym.flightcode.expressions import EMPTY, POSTFIX, Callee, Expressions, Value, literal
from satid_gym.flightcode.sources import Source

_AUGMENTED = {ast.Add: "+=", ast.Sub: "-=", ast.Mult: "*=", ast.Div: "/="}
_ROUNDS_MAX = 4  # until the types of all variables are settled


class Function(Expressions):
    """Translator of one function for arguments of given types.

    Attributes:
        result: type of what it returns; None for nothing.
        parameters: declarations of its parameters.
        lines: of its body.

    Raises:
        TranslationError: it holds what is not part of the subset.
    """

    def __init__(self, program: Callee, source: Source, arguments: list[Type]) -> None:
        super().__init__(program, source)
        self.result: Type | None = None
        self._types: dict[str, Type] = dict(zip(source.arguments, arguments, strict=True))
        self._homes = _homes(source)
        for _ in range(_ROUNDS_MAX):
            settled = dict(self._types), self.result
            self._translate()
            if settled == (self._types, self.result):
                break
        else:
            raise source.refuse(source.tree, "a function whose variables' types do not settle")
        self.parameters = [declared(self._types[name], name) for name in source.arguments]
        top = [f"    {self._declaration(name)};" for name in sorted(self._hoisted)]
        self.lines = top + self._lines
        for name in source.arguments:
            if not self._is_read(name):
                self.lines.insert(0, f"    (void){name};")
        for name in sorted(self._declared.difference(source.arguments)):
            if not self._is_read(name):
                at = next(i for i, line in enumerate(self.lines) if _mentions(name, line))
                lead = self.lines[at][: len(self.lines[at]) - len(self.lines[at].lstrip())]
                self.lines.insert(at + 1, f"{lead}(void){name};")

    def _is_read(self, name: str) -> bool:
        stored = re.compile(rf"^\s*(\w+ \(?\*?)?{name}\)?(\[\d+\])* = |^\s*\w+ \*?{name};")
        return any(_mentions(name, stored.sub("", line)) for line in self.lines)

    def _translate(self) -> None:
        self.variables = {name: Value(name, self._types[name]) for name in self.source.arguments}
        self.prelude, self._temporaries = [], 0
        self._lines: list[str] = []
        self._declared: set[str] = set(self.source.arguments)
        self._hoisted: set[str] = set()
        self._arrays: set[str] = set()
        self._block(self.source.body, 1)

    def _declaration(self, name: str) -> str:
        kind = self._types[name]
        return stored(kind, name) if name in self._arrays else declared(kind, name)

    def _say(self, depth: int, line: str) -> None:
        self._lines += ["    " * depth + text for text in [*self.prelude, line]]
        self.prelude = []

    def _block(self, body: list[ast.stmt], depth: int) -> bool:
        """Statements of a block; whether what follows it is never reached."""
        return any(self._statement(statement, body, depth) for statement in body)

    def _statement(self, node: ast.stmt, block: list[ast.stmt], depth: int) -> bool:
        if isinstance(node, ast.Assign):
            self._assign(node, block, depth)
        elif isinstance(node, ast.AugAssign):
            self._augment(node, depth)
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            self._say(depth, f"{self.value(node.value).code};")
        elif isinstance(node, ast.If):
            return self._if(node, depth)
        elif isinstance(node, ast.For):
            self._for(node, depth)
        elif isinstance(node, ast.Return):
            self._return(node, depth)
            return True
        elif isinstance(node, ast.Break | ast.Continue):
            self._say(depth, "break;" if isinstance(node, ast.Break) else "continue;")
            return True
        else:
            raise self.source.refuse(node, f"a {type(node).__name__}")
        return False

    def _return(self, node: ast.Return, depth: int) -> None:
        if node.value is None:
            self._say(depth, "return;")
            return
        found = self.value(node.value)
        self.result = join(self.result, found.type, self.source.where(node))
        self._say(depth, f"return {found.code};")

    def _if(self, node: ast.If, depth: int) -> bool:
        test = self.value(node.test)
        if test.constant is not None:
            return self._block(node.body if test.constant else node.orelse, depth)
        self._say(depth, f"if ({test.code}) {{")
        ended = self._block(node.body, depth + 1)
        if not node.orelse:
            self._say(depth, "}")
            return False
        self._say(depth, "} else {")
        other = self._block(node.orelse, depth + 1)
        self._say(depth, "}")
        return ended and other

    def _for(self, node: ast.For, depth: int) -> None:
        call, target = node.iter, node.target
        if not (isinstance(call, ast.Call) and ast.unparse(call.func) == "range" and isinstance(target, ast.Name)):
            raise self.source.refuse(node, "a loop over other than a range")
        bounds = [self.value(argument) for argument in call.args]
        start, stop = (literal(0), bounds[0]) if len(bounds) == 1 else bounds[:2]
        step = bounds[2].constant if len(bounds) > 2 else 1
        if step not in (1, -1):
            raise self.source.refuse(node, "a step other than 1 and -1")
        if start.constant is not None and stop.constant is not None and (stop.constant - start.constant) * step <= 0:
            return
        name, after = target.id, "" if stop.constant is not None else f", {target.id}_end = {stop.code}"
        end = stop.code if stop.constant is not None else f"{name}_end"
        sign, move = ("<", "++") if step == 1 else (">", "--")
        self.variables[name] = Value(name, INT)
        self._say(depth, f"for (int {name} = {start.code}{after}; {name} {sign} {end}; {name}{move}) {{")
        before = len(self._lines)
        self._block(node.body, depth + 1)
        if len(self._lines) == before:  # what it does is ruled out by the data sheet
            self._lines.pop()
        else:
            self._say(depth, "}")

    def _augment(self, node: ast.AugAssign, depth: int) -> None:
        value = self.value(node.value)
        read = ast.parse(ast.unparse(node.target), mode="eval").body
        before = self.value(ast.copy_location(read, node.target))
        result = self.operate(node, node.op, before, value)
        if isinstance(node.target, ast.Name):
            self._settle(node.target.id, result.type, node)
        if type(node.op) not in _AUGMENTED or (before.type == INT and result.type != INT and not self._name_of(node)):
            raise self.source.refuse(node, "this operator")
        if self.program.counting and result.type == DOUBLE:
            self._say(depth, f"{before.code} = {result.code};")
        else:
            self._say(depth, f"{before.code} {_AUGMENTED[type(node.op)]} {value.code};")

    @staticmethod
    def _name_of(node: ast.AugAssign) -> str | None:
        return node.target.id if isinstance(node.target, ast.Name) else None

    def _assign(self, node: ast.Assign, block: list[ast.stmt], depth: int) -> None:
        if len(node.targets) > 1:
            value = self.value(node.value)
            if value.constant is None:
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
        self._say(depth, f"const {declared(value.type, name)} = {value.code};")
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
        raise self.source.refuse(node, "an assignment of so many parts")

    def _store_place(self, target: ast.expr, value: Value, depth: int) -> None:
        place = self.value(_loaded(target))
        if not isinstance(place.type, Scalar) or not isinstance(value.type, Scalar):
            raise self.source.refuse(target, "an assignment of what is no number")
        cast = ""
        if place.type == INT and value.type == DOUBLE:
            cast = "(int32_t)"
        elif isinstance(target, ast.Subscript) and self._element(target) == "float":
            cast = "(float)"
        self._say(depth, f"{place.code} = {cast}{value.within(POSTFIX) if cast else value.code};")

    def _element(self, target: ast.Subscript) -> str:
        base = self.value(_loaded(target.value)).type
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


def _loaded(node: ast.expr) -> ast.expr:
    """The same place, to be read."""
    return ast.copy_location(ast.parse(ast.unparse(node), mode="eval").body, node)


def _mentions(name: str, line: str) -> bool:
    return re.search(rf"(?<![\w.>]){name}\b", line) is not None


def _homes(source: Source) -> dict[str, list[ast.stmt]]:
    """Block of each variable whose first mention is an assignment there, and of which no mention is outside it."""
    first: dict[str, list[ast.stmt] | None] = {}
    paths: dict[str, list[list[ast.stmt]]] = {}

    def mention(name: str, path: list[list[ast.stmt]], assigned: bool) -> None:
        if name not in first:
            first[name] = path[-1] if assigned else None
            paths[name] = path
            return
        shared = [a for a, b in zip(paths[name], path, strict=False) if a is b]
        paths[name] = shared

    def visit(block: list[ast.stmt], path: list[list[ast.stmt]]) -> None:
        for statement in block:
            inner = [getattr(statement, part, []) for part in ("body", "orelse")]
            own = [node for node in ast.iter_child_nodes(statement) if not any(node in b for b in inner)]
            assigns = isinstance(statement, ast.Assign)
            names = [n for node in own for n in ast.walk(node) if isinstance(n, ast.Name)]
            for name in sorted(names, key=lambda n: isinstance(n.ctx, ast.Store)):
                mention(name.id, path, assigns and isinstance(name.ctx, ast.Store))
            for body in inner:
                visit(body, [*path, body])

    visit(source.body, [source.body])
    return {name: home for name, home in first.items() if home is not None and paths[name][-1] is home}
