"""Policies that fly in the worlds of the studies."""

from __future__ import annotations

import numpy as np

from satid_gym.policies.rate_square import untuned_rate_square
from satid_gym.policies.registry import NotPreparedError, build, make_baseline
from satid_gym.policy import Policy
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario

_RATE = 0.95  # of the rate limit; what baselines/scenarios/tuned.json has for all of them
_REACHED = 0.25  # part of the rate limit that an open-loop signal may reach
_SINE_QUARTER = 50.0  # s, in which the sine of 0.01 Hz reaches its largest rate, as a constant torque would


def policy_for(name: str, satellite: Satellite, scenario: Scenario, control: str = "torque") -> Policy:
    """Baseline as it was tuned for the satellite; else with settings that follow from its data sheet and the horizon.

    A satellite with another rate limit than the one of its name, or another horizon, is another one in this. Open-loop
    signals of body rate have the amplitude that is best for all satellites in scenario "default".

    Raises:
        ValueError: the study does not fly this baseline.
    """
    pushes = {"one_step": scenario.horizon / 3.0, "multi_step": scenario.horizon / 6.0, "sine": _SINE_QUARTER}
    if control == "rate" and name in pushes:
        return build(name, {"amplitude": _RATE})
    known = SATELLITES.get(satellite.name, satellite)
    own = scenario.horizon == Scenario().horizon and satellite.rate_limit == known.rate_limit
    try:
        return make_baseline(name, satellite.name if own else "")
    except NotPreparedError:
        limit = satellite.rate_limit * np.mean(np.diag(satellite.inertia)) / np.min(satellite.wheels.max_torque)
    if name == "rate_square":
        return untuned_rate_square(satellite, scenario.horizon)
    if name not in pushes:
        raise ValueError(f"{name} has no settings for {satellite.name} over {scenario.horizon:g} s")
    return build(name, {"amplitude": min(1.0, _REACHED * limit / pushes[name])})
