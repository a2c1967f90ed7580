"""Mutants: a module's source with one expression or statement changed.

Operators: arithmetic swapped (+ -, * /, ** to *), comparisons negated and moved by their boundary, `and` and `or`
swapped, a sign or a `not` dropped, integers moved by one, others doubled (0 becomes 1), truth values flipped,
min and max, sine and cosine swapped, abs and sqrt dropped, the arguments of a cross product or a difference
swapped, one branch of a conditional expression always taken, a call, assignment, raise, break or continue left out.
Annotations, decorators, texts and messages are left alone.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass

_ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
}
_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_FUNCTIONS = {"min": "max", "max": "min", "sin": "cos", "cos": "sin", "minimum": "maximum", "maximum": "minimum"}
_DROPPED = {"abs", "sqrt"}
_ORDERED = {"cross", "subtract"}
_UNTOUCHED = {"annotation", "returns", "decorator_list", "type_params", "bases"}
_LEFT_OUT = (ast.AugAssign, ast.Continue, ast.Break, ast.Raise)


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One change; `before` and `after` are the statement it is in, `number` tells equal ones of a function apart."""

    function: str
    before: str
    after: str
    number: int

    @property
    def key(self) -> str:
        """What it is known by from run to run."""
        suffix = f" ({self.number})" if self.number else ""
        return f"{self.function}: {self.before} -> {self.after}{suffix}"


@dataclass(frozen=True)
class _Edit:
    """Put `new` into a field of a node, or a place of the list in that field."""

    holder: ast.AST
    field: str
    place: int | None
    new: ast.AST

    def swap(self) -> _Edit:
        """Do it; the edit that undoes it."""
        value = getattr(self.holder, self.field)
        if self.place is None:
            setattr(self.holder, self.field, self.new)
            return _Edit(self.holder, self.field, None, value)
        old, value[self.place] = value[self.place], self.new
        return _Edit(self.holder, self.field, self.place, old)


def find_mutants(source: str) -> list[Mutant]:
    """Every mutant of a module, in the order of its text."""
    found: list[Mutant] = []
    seen: dict[tuple[str, str, str], int] = {}
    for function, statement, edit in _edits(ast.parse(source)):
        before = _header(statement)
        undo = edit.swap()
        after = "pass" if edit.new.__class__ is ast.Pass else _header(statement)
        undo.swap()
        same = function, before, after
        found.append(Mutant(function=function, before=before, after=after, number=seen.get(same, 0)))
        seen[same] = seen.get(same, 0) + 1
    return found


def mutate(source: str, index: int) -> ast.Module:
    """The module with its mutant number `index` of `find_mutants`."""
    tree = ast.parse(source)
    for i, (_function, _statement, edit) in enumerate(_edits(tree)):
        if i == index:
            edit.swap()
            return ast.fix_missing_locations(tree)
    raise IndexError(f"there is no mutant {index}")


def _edits(tree: ast.Module) -> Iterator[tuple[str, ast.stmt, _Edit]]:
    """(function, statement, edit) of every mutant."""
    yield from _inside(tree, "", None)


def _inside(holder: ast.AST, function: str, statement: ast.stmt | None) -> Iterator[tuple[str, ast.stmt, _Edit]]:
    for field, value in ast.iter_fields(holder):
        if field in _UNTOUCHED:
            continue
        for place, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if not isinstance(child, ast.AST) or isinstance(child, (ast.JoinedStr, ast.Import, ast.ImportFrom)):
                continue
            around, name = statement, function
            if isinstance(child, ast.stmt):
                around = child
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
                name = f"{function}.{child.name}".lstrip(".")
            for new in _replacements(child):
                assert around is not None
                yield name, around, _Edit(holder, field, place, ast.copy_location(new, child))
            yield from _inside(child, name, around)


def _replacements(node: ast.AST) -> Iterator[ast.AST]:
    """What may stand in the place of a node."""
    match node:
        case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC:
            yield ast.BinOp(left, _ARITHMETIC[type(op)](), right)
        case ast.BoolOp(ast.And(), values):
            yield ast.BoolOp(ast.Or(), values)
        case ast.BoolOp(ast.Or(), values):
            yield ast.BoolOp(ast.And(), values)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            yield operand
        case ast.IfExp(_, body, orelse):
            yield body
            yield orelse
        case ast.Compare(left, ops, comparators):
            for i, op in enumerate(ops):
                for other in _COMPARISONS[type(op)]:
                    yield ast.Compare(left, [*ops[:i], other(), *ops[i + 1 :]], comparators)
        case ast.Constant(value):
            yield from _constants(value)
        case ast.Call():
            yield from _calls(node)
        case ast.AugAssign(target, op, value) if type(op) in _ARITHMETIC:
            yield ast.AugAssign(target, _ARITHMETIC[type(op)](), value)
    if isinstance(node, _LEFT_OUT) or _writes(node):
        yield ast.Pass()


def _writes(node: ast.AST) -> bool:
    """A statement that does its work on what was there before: leaving it out gives a valid program."""
    match node:
        case ast.Expr(ast.Call()):
            return True
        case ast.Assign([ast.Attribute() | ast.Subscript(), *_]):
            return True
    return False


def _constants(value: object) -> Iterator[ast.AST]:
    match value:
        case bool():
            yield ast.Constant(not value)
        case int():
            yield ast.Constant(value - 1 if value > 0 else 1)
        case float():
            yield ast.Constant(2.0 * value if value else 1.0)


def _calls(node: ast.Call) -> Iterator[ast.AST]:
    function, arguments = node.func, node.args
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name in _FUNCTIONS:
        other = _FUNCTIONS[name]
        renamed = (
            ast.Attribute(function.value, other, ast.Load())
            if isinstance(function, ast.Attribute)
            else ast.Name(other, ast.Load())
        )
        yield ast.Call(renamed, arguments, node.keywords)
    if name in _DROPPED and len(arguments) == 1:
        yield arguments[0]
    if name in _ORDERED and len(arguments) == 2:
        yield ast.Call(function, arguments[::-1], node.keywords)


def _header(statement: ast.stmt) -> str:
    """A statement's text; the first line of one that holds others."""
    text = ast.unparse(statement)
    return text.splitlines()[0] if hasattr(statement, "body") else " ".join(text.split())
