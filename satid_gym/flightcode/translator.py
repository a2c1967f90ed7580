"""Translator of the core's functions to C99.

The core is written in a small subset of Python: numbers, tuples, records, arrays of fixed shape, loops over ranges. All
of that has a counterpart in C, so each function becomes one C function for each set of types it is called with. What
is a number of the data sheet alone, and never assigned in flight, is put in where it is read; branches that it rules
out are left out. What the subset does not have is refused with file and line.
"""

from __future__ import annotations

import types
from collections.abc import Callable
from typing import Any

from satid_gym.flightcode.c_types import Tuple, Type, c_name, declared, tuple_struct
from satid_gym.flightcode.functions import Function
from satid_gym.flightcode.sources import Source, plain


class Translator:
    """C functions of the core, with all that they call.

    Args:
        counting: whether the code counts its operations, in `satid_operations`.

    Attributes:
        definitions: of the functions, callees first.
        structs: of the tuples that they use.
    """

    def __init__(self, counting: bool = False) -> None:
        self.counting = counting
        self.definitions: list[str] = []
        self.structs: dict[str, str] = {}
        self._known: dict[tuple[types.FunctionType, tuple[Type, ...]], tuple[str, Type | None]] = {}
        self._texts: dict[tuple[types.FunctionType, str], str] = {}
        self._names: set[str] = set()

    def call(self, function: Callable[..., Any], arguments: list[Type]) -> tuple[str, Type | None]:
        """Name and result of a function for arguments of these types, which is translated where it is not yet.

        Raises:
            TranslationError: it holds what has no translation.
        """
        key = plain(function), tuple(arguments)
        if key not in self._known:
            source = Source(function)
            found = Function(self, source, arguments)
            self._known[key] = self._define(key[0], source, found), found.result
        return self._known[key]

    def _define(self, function: types.FunctionType, source: Source, found: Function) -> str:
        body = "\n".join(found.lines)
        result = "void" if found.result is None else declared(found.result, "").rstrip()
        text = f"static {result} NAME({', '.join(found.parameters) or 'void'})\n{{\n{body}\n}}\n"
        if (function, text) not in self._texts:
            name = source.name
            while name in self._names:
                name += "_"
            self._names.add(name)
            self._texts[function, text] = name
            comment = f"{source.origin}: {source.summary}" if source.summary else source.origin
            self.definitions.append(f"/* {comment} */\n{text.replace('NAME', name, 1)}")
        return self._texts[function, text]

    def use(self, kind: Tuple) -> str:
        """Name of a tuple's struct, which is then defined."""
        for part in kind.parts:
            if isinstance(part, Tuple):
                self.use(part)
        name = c_name(kind)
        self.structs.setdefault(name, tuple_struct(kind))
        return name
