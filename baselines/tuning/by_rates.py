"""Baselines that command body rates, with the settings tuned for a satellite in a scenario, or with their default."""

from __future__ import annotations

from baselines.scenarios.rivals import rivals
from baselines.scenarios.tune import JUDGED, tuned_rival
from satid_gym.policies.open_loop_optimal import NotPreparedError
from satid_gym.policies.rate_square import RateSquarePolicy, untuned_rate_square
from satid_gym.policies.registry import BASELINES, RATE_BASELINES, build
from satid_gym.policy import Policy
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS

UNTUNED = (RateSquarePolicy.name, "zero", "random", *RATE_BASELINES)
"""Baselines that may fly a satellite or scenario that they are not tuned for."""


def baselines_of(scenario: Scenario, control: str) -> list[str]:
    """Names of the baselines that fly in a scenario where none is named."""
    if control == "torque":
        return list(BASELINES)
    return list(rivals(scenario.name)) if _is_judged(scenario) else list(UNTUNED)


def all_baselines(scenario: Scenario, control: str) -> list[str]:
    """Names of all baselines, also of those that lack settings in a scenario."""
    if control == "torque":
        return list(BASELINES)
    return list(dict.fromkeys((*BASELINES, *RATE_BASELINES, *baselines_of(scenario, control))))


def by_rates(name: str, satellite: Satellite, scenario: Scenario) -> tuple[Policy | None, str]:
    """A baseline for a satellite in a scenario, and what is to be said where its settings are not of these two.

    None where it has no default either.
    """
    line = f"{name} has no settings by body rates for satellite {satellite.name!r} in scenario {scenario.name!r}"
    if _is_judged(scenario) and name in rivals(scenario.name) and SATELLITES.get(satellite.name) == satellite:
        try:
            return tuned_rival(scenario.name, satellite.name, name)[1], ""
        except NotPreparedError as error:
            line = str(error)
    if name not in UNTUNED:
        return None, line
    if name == RateSquarePolicy.name:
        policy = untuned_rate_square(satellite, scenario.horizon)
        return policy, f"{line} (meanwhile its settings are made of the data sheet)"
    return build(name, {}), f"{line} (meanwhile it flies with its default settings)" if name in RATE_BASELINES else ""


def _is_judged(scenario: Scenario) -> bool:
    return scenario.name in JUDGED and SCENARIOS[scenario.name] == scenario
