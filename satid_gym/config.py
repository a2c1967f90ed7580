"""Base class of the settings, frozen dataclasses that convert to JSON and back, and checks of their values."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import json
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Any, Literal, Self

import numpy as np


def unknown_name(kind: str, name: object, valid: Iterable[str]) -> ValueError:
    """Error for a name that is not among the valid ones; it proposes the nearest one, if any is near."""
    names = sorted(map(str, valid))
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    return ValueError(f"unknown {kind} {name!r}; expected one of {names}.{hint}")


def check_names(kind: str, names: Iterable[object], valid: Iterable[str]) -> None:
    """Refuse unknown names and an empty list.

    Raises:
        ValueError: a name is unknown, or the list is empty.
    """
    names, valid = list(names), list(valid)
    for name in names:
        if name not in valid:
            raise unknown_name(kind, name, valid)
    if not names:
        raise ValueError(f"name at least one {kind}; expected some of {sorted(valid)}")


def real_array(name: str, value: object, *shapes: tuple[int, ...]) -> np.ndarray:
    """`value` as a read-only float64 array of one of `shapes`.

    Raises:
        ValueError: not numeric, not finite or of another shape.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iufO":  # NumPy would convert text and booleans to numbers
            raise ValueError(f"it holds {given.dtype}")
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} must be numeric, got {value!r}") from error
    if shapes and array.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise ValueError(f"{name} must have shape {expected}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {array.tolist()}")
    array.flags.writeable = False
    return array


def direction(name: str, value: object) -> np.ndarray:
    """`value`, of any length, as a read-only unit vector (3,).

    Raises:
        ValueError: not three finite numbers, or all of them 0.
    """
    given = real_array(name, value, (3,))
    length = float(np.linalg.norm(given))
    if length == 0.0:
        raise ValueError(f"{name} must be a direction, got (0, 0, 0)")
    unit = given / length
    unit.flags.writeable = False
    return unit


def check_number(name: str, value: object, *, low: float = 0.0, strict: bool = False, high: float = np.inf) -> float:
    """`value` as a float within [low, high], or (low, high] where `strict`.

    Raises:
        ValueError: not a finite number, or out of bounds.
    """
    if not _is_a(value, float):
        raise ValueError(f"{name} must be a number, got {value!r}")
    number = _number(value)
    beyond = number <= low if strict else number < low
    if not np.isfinite(number) or beyond or number > high:
        bound = f"{'more than' if strict else 'at least'} {low:g}" + (
            "" if high == np.inf else f" and at most {high:g}"
        )
        raise ValueError(f"{name} must be finite and {bound}, got {value!r}")
    return number


def check_integer(name: str, value: object, *, low: int = 1, high: int | None = None) -> int:
    """`value` as an integer within [low, high].

    Raises:
        ValueError: not an integer, or out of bounds.
    """
    if not _is_a(value, int) or value < low:  # type: ignore[operator]
        raise ValueError(f"{name} must be an integer of at least {low}, got {value!r}")
    if high is not None and value > high:  # type: ignore[operator]
        raise ValueError(f"{name} must be at most {high}, got {value!r}")
    return int(value)  # type: ignore[call-overload]


def check_flag(name: str, value: object) -> bool:
    """`value` as True or False.

    Raises:
        ValueError: anything else.
    """
    if not _is_a(value, bool):
        raise ValueError(f"{name} must be True or False, got {value!r}")
    return bool(value)


class Config:
    """Base of the settings: checked types, equality by value, conversion to and from JSON, unknown names refused."""

    def __post_init__(self) -> None:
        """Check every field that is annotated with a plain type, and convert it to that type.

        Raises:
            ValueError: a value is of another type.
        """
        for name, kind in _annotations(type(self)).items():  # type: ignore[arg-type]
            value = _typed(name, kind, getattr(self, name), type(self).__name__)
            object.__setattr__(self, name, value)

    def to_dict(self) -> dict[str, Any]:
        """Values of every field that JSON can hold."""
        return {f.name: _plain(getattr(self, f.name)) for f in dataclasses.fields(self)}  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Settings from plain values.

        Raises:
            ValueError: a name is unknown, or a value is not valid.
        """
        if not isinstance(values, Mapping):
            raise ValueError(f"settings of {cls.__name__} must be a mapping of names to values, got {values!r}")
        valid = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
        for name in values:
            if name not in valid:
                raise unknown_name(f"setting of {cls.__name__}", name, valid)
        optional = (dataclasses.MISSING, dataclasses.MISSING)
        for f in dataclasses.fields(cls):  # type: ignore[arg-type]
            if f.name not in values and (f.default, f.default_factory) == optional:
                raise ValueError(f"{cls.__name__} needs a value for {f.name!r}")
        return cls(**values)

    def _settle(self, name: str, kind: type[Config]) -> None:
        """Make a field one of a settings class, which it may be already or be given as a mapping.

        Raises:
            ValueError: it is neither, or one of its settings is not valid.
        """
        value = getattr(self, name)
        if isinstance(value, Mapping):
            object.__setattr__(self, name, kind.from_dict(value))
        elif not isinstance(value, kind):
            raise ValueError(f"{name} must be {kind.__name__} or a mapping of its settings, got {value!r}")

    def replace(self, **changes: Any) -> Self:
        """Copy with some fields changed; all checks are repeated."""
        return type(self).from_dict({**{f.name: getattr(self, f.name) for f in dataclasses.fields(self)}, **changes})  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.to_dict() == other.to_dict()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash((type(self).__name__, json.dumps(self.to_dict(), sort_keys=True)))


_KINDS: dict[type, tuple[str, tuple[type, ...]]] = {
    bool: ("True or False", (bool, np.bool_)),
    int: ("an integer", (int, np.integer)),
    float: ("a number", (int, float, np.integer, np.floating)),
    str: ("text", (str,)),
}


@functools.cache
def _annotations(cls: type) -> dict[str, Any]:
    """Annotations of a dataclass's fields, resolved."""
    hints = typing.get_type_hints(cls)
    return {f.name: hints[f.name] for f in dataclasses.fields(cls)}  # type: ignore[arg-type]


def _is_a(value: object, kind: type) -> bool:
    """Whether a value is valid for a plain type; True and False are not numbers."""
    return isinstance(value, _KINDS[kind][1]) and (kind is bool or not isinstance(value, bool))


def _number(value: Any) -> float:
    """Value as a float; infinite if an integer is too large for one."""
    try:
        return float(value)
    except OverflowError:
        return np.inf


def _typed(name: str, kind: Any, value: Any, owner: str) -> Any:
    """`value` as annotated, if the annotation is a plain type, a Literal of names, or an optional one of these.

    Other fields (arrays, ranges, nested settings) are checked by their class.
    """
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        kinds = [k for k in typing.get_args(kind) if k is not types.NoneType]
        if len(kinds) > 1 or value is None:
            return value
        (kind,) = kinds
    if typing.get_origin(kind) is Literal:
        choices = typing.get_args(kind)
        if not isinstance(value, str) or value not in choices:
            raise unknown_name(f"{name} of {owner}", value, choices)
    elif kind in _KINDS:
        if not _is_a(value, kind):
            raise ValueError(f"{name} must be {_KINDS[kind][0]}, got {value!r}")
        return _number(value) if kind is float else kind(value)
    return value


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
