"""Registry of the compiled estimators by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from satid_gym.config import unknown_name
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.rate import RateEKFSettings
from satid_gym.estimators.settings import EstimatorSettings

ESTIMATORS: dict[str, tuple[type[EstimatorSettings], dict[str, Any]]] = {
    "adaptive": (MomentumEKFSettings, {"name": "momentum", "adaptive": True}),
    "momentum": (MomentumEKFSettings, {"name": "momentum"}),
    "rate": (RateEKFSettings, {"name": "rate"}),
}
"""Settings class of each name, and the settings that the name stands for."""


def estimator_settings(value: str | Mapping[str, Any] | EstimatorSettings) -> EstimatorSettings:
    """Settings from a name, a mapping with a "name", or themselves.

    Raises:
        ValueError: the name or a setting is unknown.
    """
    if isinstance(value, EstimatorSettings):
        return value
    if isinstance(value, str):
        value = {"name": value}
    if not isinstance(value, Mapping):
        raise ValueError(
            f"estimator must be a name, a mapping or its settings, or in the single environment an object that "
            f"follows Estimator, got {value!r}"
        )
    name = value.get("name")
    if not isinstance(name, str) or name not in ESTIMATORS:
        raise unknown_name("estimator", name, ESTIMATORS)
    kind, meant = ESTIMATORS[name]
    return kind.from_dict({**meant, **{key: own for key, own in value.items() if key != "name"}})


def preset_name(settings: EstimatorSettings) -> str:
    """Name in `ESTIMATORS` that settings are a variation of; their own for an estimator that is not in it."""
    for name, (kind, meant) in ESTIMATORS.items():
        if type(settings) is kind and all(getattr(settings, key) == value for key, value in meant.items()):
            return name
    return settings.name
