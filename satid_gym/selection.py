"""Satellites, scenarios and inertia laws of a command line, given by name or by source, with distinct names.

Results, tuned settings and files are identified by name, so a satellite, scenario or law from a user's source must not
have the name of another one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from satid_gym.config import check_names
from satid_gym.laws import INERTIA_MODES, MASS_MODES, InertiaLaw
from satid_gym.resolution import resolve_inertia, resolve_satellites, resolve_scenario
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.sources import SOURCE_HINT, is_source

_VALID_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def select_satellites(texts: Sequence[str]) -> tuple[Satellite, ...]:
    """Satellites given by name, by file or by module:name.

    Raises:
        ValueError: the list is empty, an entry is unknown or not valid, or two have the same name.
    """
    _check_texts("satellite", texts, SATELLITES)
    chosen = [satellite for text in texts for satellite in resolve_satellites(text)]
    _check_labels("satellite", texts, [(satellite.name, satellite) for satellite in chosen], SATELLITES)
    return tuple(chosen)


def select_scenario(text: str) -> Scenario:
    """Scenario given by name, by file or by module:name; errors as of `select_satellites`."""
    return select_scenarios([text])[0]


def select_scenarios(texts: Sequence[str]) -> tuple[Scenario, ...]:
    """Scenarios given by name, by file or by module:name; errors as of `select_satellites`."""
    _check_texts("scenario", texts, SCENARIOS)
    chosen = [resolve_scenario(text) for text in texts]
    _check_labels("scenario", texts, [(scenario.name, scenario) for scenario in chosen], SCENARIOS)
    return tuple(chosen)


def select_inertias(
    texts: Sequence[str], valid: Sequence[str] = (*INERTIA_MODES, *MASS_MODES)
) -> tuple[str | InertiaLaw, ...]:
    """Inertia modes among `valid`, and laws given by file or by module:name; errors as of `select_satellites`."""
    _check_texts("inertia mode", texts, valid)
    chosen = [resolve_inertia(text) for text in texts]
    taken: dict[str, Any] = dict.fromkeys(("random", *INERTIA_MODES))
    own = [(label(inertia), inertia) for inertia in chosen]
    _check_labels("inertia law", texts, own, {name: name for name in taken})
    return tuple(chosen)


def label(inertia: str | InertiaLaw) -> str:
    """Name of a mode or a law in tables."""
    return inertia.label if isinstance(inertia, InertiaLaw) else inertia


def _check_texts(kind: str, texts: Sequence[str], valid: Any) -> None:
    names = [text for text in texts if not is_source(text)]
    if names or not texts:
        try:
            check_names(kind, names, valid)
        except ValueError as error:
            raise ValueError(f"{error} ({SOURCE_HINT})") from error


def _check_labels(kind: str, texts: Sequence[str], own: Sequence[tuple[str, Any]], taken: Mapping[str, Any]) -> None:
    """Refuse names that are invalid or ambiguous."""
    seen: set[str] = set()
    for text, (name, value) in zip(texts, own, strict=True):
        remedy = f'give {text} another one, by its setting "name"'
        if not _VALID_NAME.fullmatch(name):
            raise ValueError(
                f"the name of a {kind} is up to 64 letters, digits, dots, dashes and underscores, got {name!r}: "
                f"{remedy}"
            )
        if name in taken and taken[name] != value:
            raise ValueError(f"{name!r} is the name of another {kind}, in the catalogue: {remedy}")
        if name in seen:
            raise ValueError(f"two {kind}s have the name {name!r}, which identifies results: {remedy}, or leave it out")
        seen.add(name)
