"""Settings as frozen dataclasses that go to JSON and back."""

from __future__ import annotations

import dataclasses
import difflib
import json
from collections.abc import Iterable, Mapping
from typing import Any, Self

import numpy as np


def unknown_name(kind: str, name: object, valid: Iterable[str]) -> ValueError:
    """The error for a name that is not among the valid ones, with the nearest one where there is any."""
    names = sorted(valid)
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    return ValueError(f"unknown {kind} {name!r}; expected one of {names}.{hint}")


def real_array(name: str, value: object, *shapes: tuple[int, ...]) -> np.ndarray:
    """`value` as a read-only float64 array of one of `shapes`.

    Raises:
        ValueError: not numeric, not finite or of another shape.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be numeric, got {value!r}") from error
    if shapes and array.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise ValueError(f"{name} must have shape {expected}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {array.tolist()}")
    array.flags.writeable = False
    return array


def check_number(name: str, value: object, *, low: float = 0.0, strict: bool = False, high: float = np.inf) -> float:
    """`value` as a float within [low, high], or (low, high] where `strict`.

    Raises:
        ValueError: not a finite number, or out of bounds.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ValueError(f"{name} must be a number, got {value!r}")
    number = float(value)
    beyond = number <= low if strict else number < low
    if not np.isfinite(number) or beyond or number > high:
        bound = f"{'more than' if strict else 'at least'} {low:g}" + (
            "" if high == np.inf else f" and at most {high:g}"
        )
        raise ValueError(f"{name} must be finite and {bound}, got {value!r}")
    return number


class Config:
    """Base of the settings: equality by value, JSON both ways, unknown names refused."""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON-able values of every field."""
        return {f.name: _plain(getattr(self, f.name)) for f in dataclasses.fields(self)}  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Build from plain values.

        Raises:
            ValueError: a name is unknown, or a value is not valid.
        """
        valid = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
        for name in values:
            if name not in valid:
                raise unknown_name(f"setting of {cls.__name__}", name, valid)
        optional = (dataclasses.MISSING, dataclasses.MISSING)
        for f in dataclasses.fields(cls):  # type: ignore[arg-type]
            if f.name not in values and (f.default, f.default_factory) == optional:
                raise ValueError(f"{cls.__name__} needs a value for {f.name!r}")
        return cls(**values)

    def replace(self, **changes: Any) -> Self:
        """A copy with some fields changed and all checks made again."""
        return type(self).from_dict({**{f.name: getattr(self, f.name) for f in dataclasses.fields(self)}, **changes})  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.to_dict() == other.to_dict()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash((type(self).__name__, json.dumps(self.to_dict(), sort_keys=True)))


def _plain(value: Any) -> Any:
    if isinstance(value, Config):
        return value.to_dict()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    return value
