"""What a command is asked to fly, by names and sources of one's own, with names that tell results apart.

Results, tuned settings and files go by names. What is one's own may therefore not be called like another of its kind.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from satid_gym.config import check_names
from satid_gym.laws import INERTIA_MODES, InertiaLaw
from satid_gym.problem import resolve_inertia, resolve_satellites, resolve_scenario
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import SCENARIOS, Scenario
from satid_gym.sources import OWN, is_source

_PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def select_satellites(texts: Sequence[str]) -> tuple[Satellite, ...]:
    """The satellites that names, files and module:name stand for.

    Raises:
        ValueError: there is none, one is unknown or not valid, or two have one name.
    """
    _check_texts("satellite", texts, SATELLITES)
    chosen = [satellite for text in texts for satellite in resolve_satellites(text)]
    _check_labels("satellite", texts, [(satellite.name, satellite) for satellite in chosen], SATELLITES)
    return tuple(chosen)


def select_scenario(text: str) -> Scenario:
    """The scenario that a name, a file or module:name stands for; see `select_satellites`."""
    return select_scenarios([text])[0]


def select_scenarios(texts: Sequence[str]) -> tuple[Scenario, ...]:
    """The scenarios that names, files and module:name stand for; see `select_satellites`."""
    _check_texts("scenario", texts, SCENARIOS)
    chosen = [resolve_scenario(text) for text in texts]
    _check_labels("scenario", texts, [(scenario.name, scenario) for scenario in chosen], SCENARIOS)
    return tuple(chosen)


def select_inertias(texts: Sequence[str], valid: Sequence[str] = INERTIA_MODES) -> tuple[str | InertiaLaw, ...]:
    """The modes, of those that are `valid`, and laws that names, files and module:name stand for; see above."""
    _check_texts("inertia mode", texts, valid)
    chosen = [resolve_inertia(text) for text in texts]
    taken: dict[str, Any] = dict.fromkeys(("random", *INERTIA_MODES))
    own = [(label(inertia), inertia) for inertia in chosen]
    _check_labels("inertia law", texts, own, {name: name for name in taken})
    return tuple(chosen)


def label(inertia: str | InertiaLaw) -> str:
    """What tables call a mode or a law."""
    return inertia.label if isinstance(inertia, InertiaLaw) else inertia


def _check_texts(kind: str, texts: Sequence[str], valid: Any) -> None:
    names = [text for text in texts if not is_source(text)]
    if names or not texts:
        try:
            check_names(kind, names, valid)
        except ValueError as error:
            raise ValueError(f"{error} ({OWN})") from error


def _check_labels(kind: str, texts: Sequence[str], own: Sequence[tuple[str, Any]], taken: Mapping[str, Any]) -> None:
    """Refuse names that would be taken for others."""
    seen: set[str] = set()
    for text, (name, value) in zip(texts, own, strict=True):
        way_out = f'give {text} another one, by its setting "name"'
        if not _PLAIN.fullmatch(name):
            raise ValueError(
                f"the name of a {kind} is up to 64 letters, digits, dots, dashes and underscores, got {name!r}: "
                f"{way_out}"
            )
        if name in taken and taken[name] != value:
            raise ValueError(f"{name!r} is the name of another {kind}, that of the catalogue: {way_out}")
        if name in seen:
            raise ValueError(f"two {kind}s have the name {name!r}, which results go by: {way_out}, or leave it out")
        seen.add(name)
