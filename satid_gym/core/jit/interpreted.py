"""Kernels as plain Python, for debuggers, coverage and mutation testing; see `satid_gym.core.jit.entry`."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np


def interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    """The kernel as plain Python: fields are attributes; words wrap and divisions by zero pass, as compiled."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*map(_with_attributes, arguments))

    return call


def _with_attributes(argument: Any) -> Any:
    """The same memory, with the fields of its records as attributes."""
    if isinstance(argument, tuple):
        parts = map(_with_attributes, argument)
        return type(argument)(*parts) if hasattr(argument, "_fields") else tuple(parts)
    if isinstance(argument, np.ndarray) and argument.dtype.names:
        return argument.view(_record_type(argument.dtype))
    return argument


@functools.cache
def _record_type(dtype: np.dtype) -> np.dtype:
    """The dtype with scalars whose fields are attributes; numpy's own record hides those named as methods (mean)."""
    names = dtype.names or ()
    parts = [dtype.fields[name] for name in names]  # type: ignore[index]
    nested = np.dtype(
        {
            "names": list(names),
            "formats": [_record_type(part[0]) if part[0].names else part[0] for part in parts],
            "offsets": [part[1] for part in parts],
            "itemsize": dtype.itemsize,
        }
    )
    return np.dtype((type("Record", (np.void,), {name: _field(name) for name in names}), nested))


def _field(name: str) -> property:
    return property(lambda record: record[name], lambda record, value: record.__setitem__(name, value))
