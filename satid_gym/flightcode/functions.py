"""Functions of the core in C: statements, the types of local variables, and where these are declared."""

from __future__ import annotations

import ast
import re

from satid_gym.flightcode.assignments import Assignments
from satid_gym.flightcode.c_types import INT, Type, declared, join
from satid_gym.flightcode.operators import Callee, Value, literal
from satid_gym.flightcode.sources import Source

_ROUNDS_MAX = 4  # until the types of all variables are settled


class Function(Assignments):
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
        self._types = dict(zip(source.arguments, arguments, strict=True))
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
        declaration = rf"(?!return )\w+ \(?\*?{name}\)?(\[\d+\])*( = |;)"
        stored = re.compile(rf"^\s*({declaration}|{name} = )")
        return any(_mentions(name, stored.sub("", line)) for line in self.lines)

    def _translate(self) -> None:
        self.variables = {name: Value(name, self._types[name]) for name in self.source.arguments}
        self.prelude, self._temporaries = [], 0
        self._lines, self._declared, self._hoisted, self._arrays = [], set(self.source.arguments), set(), set()
        self._block(self.source.body, 1)

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
        alone = self.source.loops.count(target.id) == self.source.stores[target.id]
        name = target.id if alone else f"{target.id}_"  # so that it hides no variable
        after = "" if stop.constant is not None else f", {name}_end = {stop.code}"
        end = stop.code if stop.constant is not None else f"{name}_end"
        sign, move = ("<", "++") if step == 1 else (">", "--")
        self.variables[target.id] = Value(name, INT)
        self._say(depth, f"for (int {name} = {start.code}{after}; {name} {sign} {end}; {name}{move}) {{")
        before = len(self._lines)
        self._block(node.body, depth + 1)
        if len(self._lines) == before:  # what it does is ruled out by the data sheet
            self._lines.pop()
        else:
            self._say(depth, "}")
        del self.variables[target.id]  # in C it is gone, and has another value in Python


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
