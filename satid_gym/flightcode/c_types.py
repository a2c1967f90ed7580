"""Types of the core's values in C: numbers, tuples, arrays of fixed shape, and records.

A tuple is a struct with the array `v` where its parts are of one type, else with fields f0, f1, ...; an array is a
pointer to its first row; a record is a pointer to its struct.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


class TranslationError(ValueError):
    """A construct of the core that the translator does not know."""


@dataclass(frozen=True)
class Scalar:
    """Number: "double", "int" or "bool"."""

    name: str


DOUBLE, INT, BOOL = Scalar("double"), Scalar("int"), Scalar("bool")


@dataclass(frozen=True)
class Tuple:
    """Tuple of values."""

    parts: tuple[Type, ...]

    @property
    def is_uniform(self) -> bool:
        """Whether all parts are of one type, so that an index may be a variable."""
        return all(part == self.parts[0] for part in self.parts)


@dataclass(frozen=True, eq=False)
class Record:
    """Record of a numpy dtype.

    Attributes:
        name: of its struct in C.
        fields: types of its fields; arrays and records are parts of the struct.
        constants: fields whose value is known when the code is written; these are no part of the struct.
    """

    name: str
    fields: dict[str, Type]
    constants: dict[str, int | float] = field(default_factory=dict)


@dataclass(frozen=True)
class Array:
    """Array of fixed shape.

    Attributes:
        element: "double", "float" or "int32_t", or a record.
        shape: None for a length that is not known when the code is written, as of a slice.
    """

    element: str | Record
    shape: tuple[int | None, ...]

    @property
    def row(self) -> Type:
        """What one index gives."""
        if len(self.shape) > 1:
            return Array(self.element, self.shape[1:])
        if isinstance(self.element, Record):
            return self.element
        return INT if self.element == "int32_t" else DOUBLE


Type = Scalar | Tuple | Array | Record


def record_of(name: str, dtype: np.dtype, row: np.void | None = None, stored: frozenset[str] = frozenset()) -> Record:
    """Record of a dtype; with a `row`, numbers whose names are not among those `stored` are constants."""
    fields: dict[str, Type] = {}
    constants: dict[str, int | float] = {}
    for part in dtype.names or ():
        inner = dtype.fields[part][0]  # type: ignore[index]
        base, shape = inner.subdtype or (inner, ())
        if base.names:
            fields[part] = record_of(f"{name}_{part}", base, None if row is None else row[part], stored)
        elif shape:
            fields[part] = Array(element_of(base), tuple(shape))
        else:
            fields[part] = INT if base.kind in "iu" else DOUBLE
            if row is not None and part not in stored:
                constants[part] = row[part].item()
    return Record(name, fields, constants)


def element_of(dtype: np.dtype) -> str:
    """C type of an array's numbers.

    Raises:
        TranslationError: C has no such type.
    """
    known = {"f8": "double", "f4": "float", "i8": "int32_t"}
    code = dtype.str[1:]
    if code not in known:
        raise TranslationError(f"no C type for numbers of {dtype}: known are {sorted(known)}")
    return known[code]


def join(a: Type | None, b: Type, where: str) -> Type:
    """Type of a variable that is given values of both.

    Raises:
        TranslationError: no type holds both.
    """
    if a is None or a == b:
        return b
    if isinstance(a, Scalar) and isinstance(b, Scalar):
        order = (BOOL, INT, DOUBLE)
        return max(a, b, key=order.index)
    if isinstance(a, Tuple) and isinstance(b, Tuple) and len(a.parts) == len(b.parts):
        return Tuple(tuple(join(x, y, where) for x, y in zip(a.parts, b.parts, strict=True)))
    if isinstance(a, Array) and isinstance(b, Array) and a.element == b.element and a.shape[1:] == b.shape[1:]:
        return Array(a.element, (None, *a.shape[1:]))
    raise TranslationError(
        f"{where}: a value is of two types, {c_name(a)} and {c_name(b)}: give each a name of its own"
    )


def c_name(kind: Type) -> str:
    """Name of a type, also as a part of other names."""
    if isinstance(kind, Scalar):
        return kind.name
    if isinstance(kind, Record):
        return kind.name
    if isinstance(kind, Array):
        element = kind.element if isinstance(kind.element, str) else kind.element.name
        return "_".join(["array", element, *("n" if n is None else str(n) for n in kind.shape)])
    if kind.is_uniform:
        times = "" if isinstance(kind.parts[0], Scalar) else "x"
        return f"{c_name(kind.parts[0])}{times}{len(kind.parts)}"
    return "_".join(["tuple", *map(c_name, kind.parts)])


def declared(kind: Type, name: str) -> str:
    """Declaration of a variable, parameter or field that holds such a value; arrays and records by pointer."""
    if isinstance(kind, Scalar):
        return f"{kind.name} {name}"
    if isinstance(kind, Tuple):
        return f"{c_name(kind)} {name}"
    if isinstance(kind, Record):
        return f"{kind.name} *{name}"
    element = kind.element if isinstance(kind.element, str) else kind.element.name
    inner = "".join(f"[{max(n or 0, 1)}]" for n in kind.shape[1:])
    return f"{element} (*{name}){inner}" if inner else f"{element} *{name}"


def stored(kind: Type, name: str) -> str:
    """Declaration of a field that is the value itself."""
    if isinstance(kind, Array):
        element = kind.element if isinstance(kind.element, str) else kind.element.name
        return f"{element} {name}" + "".join(f"[{max(n or 0, 1)}]" for n in kind.shape)
    if isinstance(kind, Record):
        return f"{kind.name} {name}"
    return f"{'int32_t' if kind == INT else kind.name if isinstance(kind, Scalar) else c_name(kind)} {name}"


def tuple_struct(kind: Tuple) -> str:
    """Definition of a tuple's struct."""
    if kind.is_uniform:
        body = declared(kind.parts[0], f"v[{len(kind.parts)}]")
        return f"typedef struct {{ {body}; }} {c_name(kind)};"
    body = " ".join(f"{declared(part, f'f{i}')};" for i, part in enumerate(kind.parts))
    return f"typedef struct {{ {body} }} {c_name(kind)};"


def record_structs(kind: Record) -> list[str]:
    """Definitions of a record's struct and of those in it, in order; constants are left out."""
    lines: list[str] = []
    for part in kind.fields.values():
        if isinstance(part, Record):
            lines += record_structs(part)
    own = [f"    {stored(part, name)};" for name, part in kind.fields.items() if name not in kind.constants]
    return [*lines, "\n".join(["typedef struct {", *(own or ["    char empty;"]), f"}} {kind.name};"]) + "\n"]


def number(value: float | bool) -> str:
    """Literal of a number; a double's is read back as the same double."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if np.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    text = repr(float(value))
    return text if set(text) & set(".e") else f"{text}.0"


def initialiser(kind: Type, value: Any, depth: int = 0) -> str:
    """Braces of a record, an array or a number, as numpy has it."""
    if isinstance(kind, Record):
        lead = "    " * (depth + 1)
        parts = [
            f"{lead}.{name} = {initialiser(part, value[name], depth + 1)}"
            for name, part in kind.fields.items()
            if name not in kind.constants
        ]
        return "{\n" + ",\n".join(parts or [f"{lead}0"]) + "\n" + "    " * depth + "}"
    if isinstance(kind, Array):
        return _rows(np.asarray(value))
    return number(int(value) if kind == INT else float(value))


def _rows(values: np.ndarray) -> str:
    if values.size == 0:
        return "{0}" if values.ndim == 1 else "{{0}}" if values.ndim == 2 else "{{{0}}}"
    if values.ndim > 1:
        return "{" + ", ".join(map(_rows, values)) + "}"
    return "{" + ", ".join(number(x) for x in values.tolist()) + "}"
