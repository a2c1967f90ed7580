"""Choice of the policy that a pilot flies."""

from __future__ import annotations

from satid_gym.policies import BASELINES, RATE_BASELINES, find, make_baseline, names
from satid_gym.policy import Policy


def policy_by_name(name: str, satellite: str, scenario: str) -> Policy:
    """Policy by name or path.

    Raises:
        ValueError: there is none, or a baseline is not tuned for the satellite.
    """
    is_baseline = name in {**BASELINES, **RATE_BASELINES} and name not in names()
    return make_baseline(name, satellite, scenario) if is_baseline else find(name)
