"""Choice of the policy that is flown, by a name or a path."""

from __future__ import annotations

from pathlib import Path

from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.policies import BASELINES, RATE_BASELINES, find, make_baseline, names
from satid_gym.policy import Policy


def policy_by_name(name: str, satellite: str, scenario: str) -> Policy:
    """Policy by name, by path, or by the path of a design.json.

    Raises:
        ValueError: there is none, or a baseline is not tuned for the satellite.
    """
    if name.endswith(".json") and not Path(name).with_suffix(".safetensors").exists():
        return ManoeuvrePolicy.read(Path(name))
    is_baseline = name in {**BASELINES, **RATE_BASELINES} and name not in names()
    return make_baseline(name, satellite, scenario) if is_baseline else find(name)
