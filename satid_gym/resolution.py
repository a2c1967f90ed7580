"""Resolution of a user's satellite, law or scenario, given as a name, a file, module:name or a mapping."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

from satid_gym import sources
from satid_gym.config import unknown_name
from satid_gym.laws import INERTIA_MODES, MASS_MODES, InertiaLaw
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS

SatelliteLike = str | Satellite | Mapping[str, Any] | Sequence[str | Satellite | Mapping[str, Any]]
InertiaLike = str | InertiaLaw | Mapping[str, Any]
ScenarioLike = str | Scenario | Mapping[str, Any]
_ALIKE = 0.8  # similarity of a name to another from which on it may be a slip


def resolve_satellites(satellite: SatelliteLike) -> tuple[Satellite, ...]:
    """The satellites that a name, a file, module:name, a satellite, a mapping or a list of these stands for.

    Raises:
        ValueError: a name is unknown or a value is not valid.
    """
    if isinstance(satellite, str) and satellite == "random":
        return tuple(SATELLITES[name] for name in BENCHMARK_SATELLITES)
    if isinstance(satellite, (str, Satellite, Mapping)):
        return (_satellite(satellite),)
    if not isinstance(satellite, Sequence) or not satellite:
        raise ValueError(
            "satellite must be a name, a file, module:name, a Satellite, a mapping or a list of these, "
            f"got {satellite!r}"
        )
    return tuple(_satellite(s) for s in satellite)


def _satellite(value: str | Satellite | Mapping[str, Any]) -> Satellite:
    if isinstance(value, Satellite):
        return value
    if isinstance(value, Mapping):
        return Satellite.from_dict(value)
    if isinstance(value, str) and value in SATELLITES:
        return SATELLITES[value]
    if not sources.is_source(value):
        raise sources.unknown("satellite", value, [*SATELLITES, "random"])
    return sources.load(value, Satellite, Satellite.from_dict)


def resolve_inertia(value: InertiaLike) -> str | InertiaLaw:
    """The law or mode that a name, a file, module:name, a law or a mapping stands for.

    Raises:
        ValueError: a name is unknown or a value is not valid.
    """
    if isinstance(value, InertiaLaw):
        return value
    if isinstance(value, Mapping):
        return InertiaLaw.from_dict(value)
    modes = ("random", *INERTIA_MODES, *MASS_MODES)
    if isinstance(value, str) and value in modes:
        return value
    if not sources.is_source(value):
        raise sources.unknown("inertia mode", value, modes)
    return sources.load(value, InertiaLaw, InertiaLaw.from_dict)


def resolve_scenario(value: ScenarioLike) -> Scenario:
    """The scenario that a name, a file, module:name, a scenario or a mapping stands for.

    A mapping changes settings of the scenario that it names as its `base`, or else by its own name.

    Raises:
        ValueError: a name is unknown, or almost that of a scenario without a `base`, or a value is not valid.
    """
    if isinstance(value, Scenario):
        return value
    if isinstance(value, Mapping):
        return _changed_scenario(value)
    if isinstance(value, str) and value in SCENARIOS:
        return SCENARIOS[value]
    if not sources.is_source(value):
        raise sources.unknown("scenario", value, SCENARIOS)
    return sources.load(value, Scenario, _changed_scenario)


def _changed_scenario(value: Mapping[str, Any]) -> Scenario:
    changes = dict(value)
    base = changes.pop("base", changes.get("name", "default"))
    if isinstance(base, str) and base in SCENARIOS:
        return SCENARIOS[base].replace(**changes)
    if "base" in value:
        raise unknown_name("base of a scenario", base, SCENARIOS)
    if near := difflib.get_close_matches(str(base), SCENARIOS, 1, _ALIKE):
        raise ValueError(
            f"scenario {base!r} is named almost like {near[0]!r}: say which one its settings change, by "
            f'base="{near[0]}" or base="default"'
        )
    return Scenario.from_dict(changes)
