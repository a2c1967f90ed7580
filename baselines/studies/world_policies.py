"""Policies that fly in the worlds of the studies."""

from __future__ import annotations

import numpy as np

from baselines.scenarios.tune import tuned_rival
from satid_gym.policies.rate_square import untuned_rate_square
from satid_gym.policies.registry import NotPreparedError, build, make_baseline
from satid_gym.policy import Policy
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario

_REACHED = 0.25  # part of the rate limit that an open-loop signal may reach
_SINE_QUARTER = 50.0  # s, in which the sine of 0.01 Hz reaches its largest rate, as a constant torque would


def policy_for(name: str, satellite: Satellite, scenario: Scenario, control: str = "torque") -> Policy:
    """Baseline as it was tuned for the satellite; else with settings that follow from its data sheet and the horizon.

    A satellite with another rate limit than the one of its name, or another horizon, is another one in this. By body
    rates there are baselines that were tuned alone.

    Raises:
        ValueError: the study does not fly this baseline, or it was not tuned.
    """
    if control == "rate":
        return tuned_rival("default", satellite.name, name)[1]
    known = SATELLITES.get(satellite.name, satellite)
    own = scenario.horizon == Scenario().horizon and satellite.rate_limit == known.rate_limit
    try:
        return make_baseline(name, satellite.name if own else "")
    except NotPreparedError:
        limit = satellite.rate_limit * np.mean(np.diag(satellite.inertia)) / np.min(satellite.wheels.max_torque)
    if name == "rate_square":
        return untuned_rate_square(satellite, scenario.horizon)
    pushes = {"one_step": scenario.horizon / 3.0, "multi_step": scenario.horizon / 6.0, "sine": _SINE_QUARTER}
    if name not in pushes:
        raise ValueError(f"{name} has no settings for {satellite.name} over {scenario.horizon:g} s")
    return build(name, {"amplitude": min(1.0, _REACHED * limit / pushes[name])})
