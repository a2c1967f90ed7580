"""Kernels of the rate loop as ONNX nodes: their own source, interpreted on rows of a batch.

Loops over wheels and axes are unrolled. A branch is taken for all rows, and what it stores is kept in those rows where
its condition holds. A loop with a break becomes a loop of the graph that ends when all rows have left it.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from agents.training.graph.rows import Builder, Row
from satid_gym.flightcode.sources import Source, is_part, loaded, plain

_OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Lt: operator.lt,
    ast.Gt: operator.gt,
    ast.LtE: operator.le,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
}
_FUNCTIONS: dict[Any, str] = {np.sqrt: "Sqrt", np.sign: "Sign"}


class Interpreter:
    """A function of the core on rows.

    Args:
        builder: takes the nodes.
        batch: a row of zeros, as long as the batch.
        function: of the core, plain or compiled.
        mask: rows for which it is called; what it stores in arrays reaches no others.
    """

    def __init__(self, builder: Builder, batch: Row, function: Callable[..., Any], mask: Row | bool = True) -> None:
        self._builder, self._batch, self._source = builder, batch, Source(function)
        self._names: dict[str, Any] = {}
        self._caller = mask
        self._branch: Row | bool = True  # rows of the branch that is taken
        self._live: Row | bool = True  # rows that have not returned
        self._broken: Row | bool = False  # rows that have left the loop
        self._result: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """What it returns for arrays, tuples and numbers, whose numbers may be rows.

        Raises:
            TranslationError: it holds what has no counterpart.
        """
        self._names = dict(zip(self._source.arguments, arguments, strict=True))
        self._block(self._source.body)
        return self._result

    @property
    def _mask(self) -> Row | bool:
        return self._builder.both(self._caller, self._builder.both(self._branch, self._live))

    def _block(self, body: list[ast.stmt]) -> None:
        for statement in body:
            run = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if run is None:
                raise self._source.refuse(statement, f"a {type(statement).__name__} in ONNX")
            run(statement)
            if self._live is False or self._broken is True:
                return

    def _assign(self, node: ast.Assign) -> None:
        value = self._value(node.value)
        for target in node.targets:
            self._store(target, value)

    def _augassign(self, node: ast.AugAssign) -> None:
        place = loaded(node.target)
        self._store(node.target, _OPERATORS[type(node.op)](self._value(place), self._value(node.value)))

    def _store(self, target: ast.expr, value: Any) -> None:
        if isinstance(target, ast.Tuple):
            for part, own in zip(target.elts, list(value), strict=True):
                self._store(part, own)
        elif isinstance(target, ast.Name):
            before = self._names.get(target.id)
            self._names[target.id] = value if before is None else self._merged(self._branch, value, before)
        elif isinstance(target, ast.Subscript):
            array, place = self._value(target.value), self._value(target.slice)
            before = array[place]
            array[place] = value if before is None else self._merged(self._mask, value, before)
        else:
            raise self._source.refuse(target, "such a target in ONNX")

    def _merged(self, mask: Row | bool, value: Any, before: Any) -> Any:
        if mask is True:
            return value
        if isinstance(value, tuple):
            return tuple(self._merged(mask, one, other) for one, other in zip(value, before, strict=True))
        return self._builder.choose(mask, value, before)

    def _expr(self, node: ast.Expr) -> None:
        self._value(node.value)

    def _return(self, node: ast.Return) -> None:
        value = None if node.value is None else self._value(node.value)
        here = self._builder.both(self._branch, self._live)
        self._result = value if self._result is None else self._merged(here, value, self._result)
        self._live = self._builder.both(self._live, self._builder.invert(self._branch))

    def _break(self, node: ast.Break) -> None:
        self._broken = self._builder.either(self._broken, self._branch)

    def _if(self, node: ast.If) -> None:
        test = self._value(node.test)
        if not isinstance(test, Row):
            self._block(node.body if test else node.orelse)
            return
        outside = self._branch
        for condition, body in ((test, node.body), (self._builder.invert(test), node.orelse)):
            self._branch = self._builder.both(outside, condition)
            self._block(body)
        self._branch = outside

    def _for(self, node: ast.For) -> None:
        assert isinstance(node.target, ast.Name)
        if any(isinstance(part, ast.Break) for part in ast.walk(node)):
            self._loop(node)
            return
        for k in self._value(node.iter):
            self._names[node.target.id] = k
            self._block(node.body)

    def _loop(self, node: ast.For) -> None:
        """A loop of the graph: what its body changes goes from one round to the next."""
        names, arrays = self._changed(node)

        def turn(values: list[Row]) -> tuple[list[Any], Row | bool]:
            self._restore(names, arrays, values)
            self._broken, self._branch = False, True
            self._block(node.body)
            return self._flat(names, arrays), self._builder.invert(self._broken)

        kept, before = self._branch, [self._row(x) for x in self._flat(names, arrays)]
        active = self._mask if isinstance(self._mask, Row) else self._batch >= float(not self._mask)
        after = self._builder.loop(len(self._value(node.iter)), active, before, turn)
        self._broken, self._branch = False, kept
        self._restore(names, arrays, after)

    def _changed(self, node: ast.For) -> tuple[list[str], list[str]]:
        """Variables and arrays of before the loop that its body changes."""
        stores = [n for n in ast.walk(node) if isinstance(getattr(n, "ctx", None), ast.Store)]
        turns = {ast.unparse(n.target) for n in ast.walk(node) if isinstance(n, ast.For)}
        names = {n.id for n in stores if isinstance(n, ast.Name)} & set(self._names) - turns
        arrays = {n.value.id for n in stores if isinstance(n, ast.Subscript) and isinstance(n.value, ast.Name)}
        return sorted(names), sorted(arrays)

    def _flat(self, names: list[str], arrays: list[str]) -> list[Any]:
        values = [x for name in names for x in np.ravel(np.array(self._names[name], object))]
        return values + [x for name in arrays for x in np.ravel(self._names[name])]

    def _restore(self, names: list[str], arrays: list[str], values: list[Row]) -> None:
        left = iter(values)
        for name in names:
            value = self._names[name]
            self._names[name] = _filled(value, left)
        for name in arrays:
            array = self._names[name]
            for place in np.ndindex(array.shape):
                array[place] = next(left)

    def _row(self, x: Any) -> Row:
        return x if isinstance(x, Row) else self._batch + float(x)

    def _value(self, node: ast.expr) -> Any:
        known = self._source.known(node)
        if known is not None:
            return known
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            return self._names[node.id]
        if isinstance(node, ast.Tuple):
            return tuple(map(self._value, node.elts))
        if isinstance(node, ast.Attribute):
            return getattr(self._value(node.value), node.attr)
        if isinstance(node, ast.Subscript):
            return self._value(node.value)[self._value(node.slice)]
        if isinstance(node, ast.BinOp):
            return _OPERATORS[type(node.op)](self._value(node.left), self._value(node.right))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -self._value(node.operand)
        if isinstance(node, ast.Compare):
            return _OPERATORS[type(node.ops[0])](self._value(node.left), self._value(node.comparators[0]))
        if isinstance(node, ast.BoolOp):
            found, *others = map(self._value, node.values)
            for other in others:
                found = (self._builder.both if isinstance(node.op, ast.And) else self._builder.either)(found, other)
            return found
        if isinstance(node, ast.IfExp):
            test = self._value(node.test)
            if not isinstance(test, Row):
                return self._value(node.body if test else node.orelse)
            return self._merged(test, self._value(node.body), self._value(node.orelse))
        if isinstance(node, ast.Call):
            return self._call(node)
        raise self._source.refuse(node, f"a {type(node).__name__} in ONNX")

    def _call(self, node: ast.Call) -> Any:
        function, arguments = self._source.known(node.func), [self._value(argument) for argument in node.args]
        if is_part(function):
            return Interpreter(self._builder, self._batch, plain(function), self._mask)(*arguments)
        if function is np.empty:
            return np.full(arguments[0], None, dtype=object)
        if function in (min, max):
            first, *others = arguments
            for other in others:
                first = self._extreme(function, first, other)
            return first
        if function in _FUNCTIONS and isinstance(arguments[0], Row):
            return self._builder.operate(_FUNCTIONS[function], arguments[0])
        if function in (abs, range, np.sqrt, np.sign):
            return function(*arguments)
        raise self._source.refuse(node, "a call of this function in ONNX")

    def _extreme(self, function: Any, a: Any, b: Any) -> Any:
        if not isinstance(a, Row) and not isinstance(b, Row):
            return function(a, b)
        better = b < a if function is min else b > a  # as Python: the first where neither is
        return self._builder.choose(better, b, a)


def _filled(value: Any, left: Iterator[Row]) -> Any:
    """The rows that are left in place of those of a value, which may be a tuple of tuples."""
    return tuple(_filled(part, left) for part in value) if isinstance(value, tuple) else next(left)
