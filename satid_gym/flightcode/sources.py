"""Sources of the core's functions: syntax trees, what their names stand for, and which fields of records they store."""

from __future__ import annotations

import ast
import builtins
import inspect
import textwrap
import types
from collections.abc import Callable, Iterable
from typing import Any

from satid_gym.flightcode.c_types import TranslationError


class Source:
    """Function of the core as a syntax tree.

    Args:
        function: plain, or compiled by numba.

    Attributes:
        name: of its module and its own.
        origin: dotted name in Python.
        summary: first line of its docstring.
        arguments: their names.
        body: its statements, without the docstring.
        stores: how often each local variable is assigned, by name.
        loops: names of the loops' variables.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._plain = plain(function)
        lines, self._first = inspect.getsourcelines(self._plain)
        tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        self.tree = tree
        self.name = f"{self._plain.__module__.rpartition('.')[2]}_{tree.name.lstrip('_')}"
        self.origin = f"{self._plain.__module__}.{tree.name}"
        self.summary = (ast.get_docstring(tree) or "").partition("\n")[0]
        self.arguments = [argument.arg for argument in tree.args.args]
        self.body = tree.body[1:] if ast.get_docstring(tree) else tree.body
        self.stores: dict[str, int] = dict.fromkeys(self.arguments, 1)
        self.loops = [ast.unparse(node.target) for node in ast.walk(tree) if isinstance(node, ast.For)]
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                self.stores[node.id] = self.stores.get(node.id, 0) + 1

    def where(self, node: ast.AST) -> str:
        """File and line of a node, for a message."""
        line = self._first + getattr(node, "lineno", 1) - 1
        return f"{self._plain.__module__.replace('.', '/')}.py:{line}"

    def refuse(self, node: ast.AST, what: str) -> TranslationError:
        """Error for a construct that has no translation."""
        return TranslationError(
            f"{self.where(node)}: no C for {what}, {ast.unparse(node)!r}: write it in the core's subset"
        )

    def known(self, node: ast.expr) -> Any:
        """What a global name, or an attribute of a module, stands for; None for anything else."""
        if isinstance(node, ast.Name) and node.id not in self.stores:
            return self._plain.__globals__.get(node.id, getattr(builtins, node.id, None))
        if isinstance(node, ast.Attribute):
            home = self.known(node.value)
            if isinstance(home, types.ModuleType):
                return getattr(home, node.attr)
        return None


def plain(function: Callable[..., Any]) -> types.FunctionType:
    """The Python function that numba compiled, or that stands for itself."""
    found = inspect.unwrap(getattr(function, "py_func", function))
    assert isinstance(found, types.FunctionType)
    return found


def loaded(node: ast.expr) -> ast.expr:
    """The same place, to be read."""
    return ast.copy_location(ast.parse(ast.unparse(node), mode="eval").body, node)


def is_part(value: Any) -> bool:
    """Whether a value is a function of the core, and not one of numpy or Python."""
    found = getattr(value, "py_func", value)
    return isinstance(found, types.FunctionType) and found.__module__.startswith("satid_gym.")


def stored_fields(functions: Iterable[Callable[..., Any]]) -> frozenset[str]:
    """Names of the fields that are assigned by these functions and by all that they call."""
    found: set[str] = set()
    seen: set[types.FunctionType] = set()
    left = [plain(function) for function in functions]
    while left:
        function = left.pop()
        if function in seen:
            continue
        seen.add(function)
        source = Source(function)
        for node in ast.walk(source.tree):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                found.add(node.attr)
            if isinstance(node, ast.Call) and is_part(called := source.known(node.func)):
                left.append(plain(called))
    return frozenset(found)
