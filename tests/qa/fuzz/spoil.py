"""Spoil a valid configuration in one place, so that no environment may accept it."""

from __future__ import annotations

import copy
import dataclasses
import traceback
import typing
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import satid_gym
from satid_gym import InertiaLaw, LawRanges, ReactionWheels, RewardSettings, Satellite, SatInertiaIDEnv, Scenario
from satid_gym.estimators import ESTIMATORS
from satid_gym.faults import Faults
from satid_gym.friction import WheelFriction
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances
from tests.qa.fuzz.configuration import Configuration, Settings
from tests.qa.fuzz.flight import Violation

_LIBRARY = str(Path(satid_gym.__file__).parent)
_TYPES: dict[str, Callable[[Settings], Any]] = {
    "satellite": lambda s: Satellite,
    "satellite.wheels": lambda s: ReactionWheels,
    "satellite.wheels.friction": lambda s: WheelFriction,
    "scenario": lambda s: Scenario,
    "scenario.laws": lambda s: LawRanges,
    "scenario.faults": lambda s: Faults,
    "scenario.tolerances": lambda s: Tolerances,
    "scenario.sensors": lambda s: Sensors,
    "reward": lambda s: RewardSettings,
    "estimator": lambda s: ESTIMATORS[s["estimator"]["name"]][0],
    "inertia": lambda s: InertiaLaw,
}
_SIGNED = ("phase",)  # numbers that may be negative
_NO_TEXT: list[Any] = [3, 1.5, ["x"], {}, b"x", True]
_NO_FLAG: list[Any] = ["no", 1, 0.0, None, []]
_NO_WHOLE: list[Any] = ["3", 1.5, 0, -1, True, None, [1]]
_NO_NUMBER: list[Any] = ["1", None, True, [1.0], {}, 1j, float("nan"), float("inf"), -float("inf"), b"1", 10**400]
_NO_ARRAY: list[Any] = ["heavy", None, 1j, [1.0, 2.0], [[1.0, 2.0], [3.0]], {}, [True, False, True], ["1", "1", "1"]]
_NO_RANGE: list[Any] = [3.0, "ab", None, (2.0, 1.0), (float("nan"), 1.0), (1.0,), (0.0, 1e9), {}]
_NO_SETTINGS: list[Any] = [3, "xx", True, 1j, [3], ["xx"], object(), b"x"]


def spoil(chance: Random, configuration: Configuration) -> tuple[Settings, str]:
    """Settings with one thing wrong, and what."""
    settings = copy.deepcopy(configuration.settings)
    how = chance.choice((_spoil_field, _spoil_field, _spoil_field, _misspell, _spoil_argument, _spoil_physics))
    return settings, how(chance, settings)


def _place(settings: Settings, path: str) -> Settings:
    for name in path.split("."):
        settings = settings[name]
    return settings


def _groups(settings: Settings) -> list[str]:
    return [path for path in _TYPES if path != "inertia" or isinstance(settings["inertia"], dict)]


def _spoil_field(chance: Random, settings: Settings) -> str:
    path = chance.choice(_groups(settings))
    cls = _TYPES[path](settings)
    field = chance.choice(dataclasses.fields(cls))
    kind = typing.get_type_hints(cls)[field.name]
    value = chance.choice([value for value in _wrong(field.name, kind) if value is not field.default])
    _place(settings, path)[field.name] = value
    return f"{path}.{field.name} = {value!r}"


def _wrong(name: str, kind: Any) -> list[Any]:
    """Values that a field of this name and annotation must refuse."""
    optional = type(None) in typing.get_args(kind)
    kinds = [k for k in typing.get_args(kind) if k is not type(None)] if optional else [kind]
    if kinds == [float]:
        wrong = [*_NO_NUMBER, *([] if name in _SIGNED else [-2.0])]
    elif kinds == [bool]:
        wrong = _NO_FLAG
    elif kinds == [int]:
        wrong = _NO_WHOLE
    elif kinds == [str]:
        wrong = [*_NO_TEXT, None]
    elif typing.get_origin(kinds[0]) is typing.Literal:
        wrong = [*_NO_TEXT, None, "xx"]
    elif kinds == [np.ndarray]:
        wrong = [*_NO_ARRAY, [float("nan")] * 3, np.zeros((2, 2, 2))]
    elif typing.get_origin(kinds[0]) is tuple:
        wrong = _NO_RANGE
    else:
        wrong = _NO_SETTINGS
    return [value for value in wrong if value is not None or not optional]


def _misspell(chance: Random, settings: Settings) -> str:
    path = chance.choice(_groups(settings))
    group = _place(settings, path)
    name = chance.choice(sorted(group))
    wrong = name[:-1] if len(name) > 1 else name + "x"
    group[wrong] = group[name]
    return f"{path} has {wrong!r}"


def _spoil_argument(chance: Random, settings: Settings) -> str:
    name, wrong = chance.choice(
        [
            ("satellite", [None, 3, "xx", [], ["cubesat", 3], [["cubesat"]], np.array(["cubesat"]), True]),
            ("inertia", [None, 3, "xx", ["step"], True]),
            ("scenario", [None, 3, "xx", ["default"], True]),
            ("estimator", [3, "xx", ["momentum"], True, {"parameters": "full"}, {"name": ["momentum"]}]),
            ("reward", [3, "xx", ["logdet"], True]),
            ("max_episode_steps", [0, -1, 1.5, "3", True, [3], 10**12]),
            ("render_mode", ["xx", 3, "human"]),
        ]
    )
    settings[name] = chance.choice(wrong)
    return f"{name} = {settings[name]!r}"


def _spoil_physics(chance: Random, settings: Settings) -> str:
    satellite, scenario = settings["satellite"], settings["scenario"]
    inertia = np.array(satellite["inertia"])
    axes = np.array(satellite["wheels"]["axes"])
    size = float(np.trace(inertia))
    plane = axes - np.outer([0.0, 0.0, 1.0], axes[2])
    flat = plane / np.maximum(np.linalg.norm(plane, axis=0), 1e-12)
    what, place, name, value = chance.choice(
        [
            ("triangle inequality", satellite, "inertia", [size, size, 3.0 * size]),
            ("asymmetric", satellite, "inertia", inertia + size * np.tri(3, k=-1)),
            ("indefinite", satellite, "inertia", inertia - size * np.eye(3)),
            ("less than the wheels", satellite["wheels"], "inertia", size),
            ("long axes", satellite["wheels"], "axes", 1.1 * axes),
            ("axes in a plane", satellite["wheels"], "axes", flat),
            ("two wheels", satellite["wheels"], "axes", axes[:, :2]),
            ("no torque", satellite["wheels"], "max_torque", 0.0),
            ("periods", scenario, "decision_period", 1.37 * scenario["sample_period"]),
            ("horizon", scenario, "horizon", 0.4 * scenario["decision_period"]),
            ("beyond all samples", scenario, "sample_period", scenario["sample_period"] * 1e-200),
            ("unknown satellite", scenario, "prior_scale", {"fuzed": 1.0}),
            ("prior scale", scenario, "prior_scale", {"*": chance.choice([0.0, -1.0, "1", True, None])}),
        ]
    )
    place[name] = value
    return what


def refused(settings: Settings) -> str:
    """The message with which the environment refuses.

    Raises:
        Violation: it was accepted, or the refusal came from somewhere deep or says nothing.
    """
    try:
        SatInertiaIDEnv(**settings)
    except (ValueError, TypeError) as error:
        place = traceback.extract_tb(error.__traceback__)[-1].filename
        if not place.startswith(_LIBRARY) or len(str(error)) < 15:
            raise Violation(f"refused by {place}, saying {error}") from error
        return str(error)
    except Exception as error:
        raise Violation(f"refused with {type(error).__name__}: {error}") from error
    raise Violation("accepted")


def refuses_actions(env: SatInertiaIDEnv, chance: Random) -> None:
    """Actions that are none are refused, and change nothing.

    Raises:
        Violation: one was taken, refused for another reason or left something changed.
    """
    n = env.action_space.shape[0]
    records = env.fleet.rows
    before = b"".join(record.tobytes() for record in records)
    wrong = [np.nan, np.inf, -np.inf, 1e39]
    spoilt: list[Any] = [np.where(np.arange(n) == chance.randrange(n), value, 0.0) for value in wrong]
    spoilt += [None, "x", 0.0, [0.0] * (n + 1), [[0.0] * n], ["0"] * n, [1j] * n, [None] * n, {}, [[0.0], [0.0, 0.0]]]
    for action in spoilt:
        try:
            env.step(action)
        except ValueError as error:
            if "action must be" not in str(error) and "action must have" not in str(error):
                raise Violation(f"action {action!r} refused, saying {error}") from error
        else:
            raise Violation(f"action {action!r} was taken")
    if b"".join(record.tobytes() for record in records) != before:
        raise Violation("a refused action changed the environment")
