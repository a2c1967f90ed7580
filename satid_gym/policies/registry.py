"""All baselines by name, with the settings that `python -m baselines.tune` found for them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from satid_gym.config import unknown_name
from satid_gym.policies.greedy import GreedyPolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policies.open_loop_optimal import (
    DESIGNS,
    PREPARED_AS,
    NotPreparedError,
    OpenLoopOptimalPolicy,
    design_of,
    entries_of,
)
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import RandomPolicy, ZeroPolicy
from satid_gym.policies.scripted import ScriptedPolicy, staggered_square
from satid_gym.policy import Policy
from satid_gym.profiles import PROFILES

TUNED = Path(__file__).with_name("tuned.json")


def _staggered_square(amplitude: float, period: float) -> ScriptedPolicy:
    return ScriptedPolicy("staggered_square", functools.partial(staggered_square, period=period), amplitude)


BASELINES: dict[str, Callable[..., Policy]] = {
    **{name: functools.partial(ScriptedPolicy, name, profile) for name, profile in PROFILES.items()},
    "staggered_square": _staggered_square,
    "open_loop_optimal": OpenLoopOptimalPolicy,
    "rate_square": RateSquarePolicy,
    "greedy": functools.partial(GreedyPolicy, "greedy", 1),
    "greedy_horizon": functools.partial(GreedyPolicy, "greedy_horizon", 8),
    "mpc": MPCPolicy,
    "random": RandomPolicy,
    "zero": ZeroPolicy,
}
UNTUNED = ("open_loop_optimal", "random", "zero")  # no sweep sets them


def build(name: str, settings: dict[str, float]) -> Policy:
    """A baseline with settings of one's own.

    Raises:
        ValueError: the name is unknown or a setting is not valid.
        TypeError: a setting is missing or unknown.
    """
    if name not in BASELINES:
        raise unknown_name("baseline", name, BASELINES)
    return BASELINES[name](**settings)


def make_baseline(
    name: str, satellite: str, scenario: str = "default", *, tuned: Path = TUNED, designs: Path = DESIGNS
) -> Policy:
    """A baseline with the settings that were found for a satellite in a scenario.

    Args:
        name: of the baseline.
        satellite, scenario: their names.
        tuned: file of `python -m baselines.tune`; what it lacks is taken from the one that is shipped.
        designs: file of `python -m baselines.design`, likewise.

    Raises:
        ValueError: the name is unknown, or there are no settings for that satellite and scenario.
    """
    if name == OpenLoopOptimalPolicy.name:
        design = design_of(satellite, scenario, designs)
        return OpenLoopOptimalPolicy(design["dwell"], design["fraction"])
    return build(name, {} if name in UNTUNED else tuned_entry(name, satellite, scenario, tuned)["settings"])


def tuned_entry(name: str, satellite: str, scenario: str = "default", tuned: Path = TUNED) -> dict[str, Any]:
    """Settings of a baseline and the score they reached in tuning; arguments as of `make_baseline`.

    Raises:
        ValueError: the name is unknown, or it was not tuned for that satellite and scenario.
    """
    if name not in BASELINES:
        raise unknown_name("baseline", name, BASELINES)
    scenario = PREPARED_AS.get(scenario, scenario)
    for file in (tuned, TUNED):
        found = entries_of(file, "baselines.tune").get((name, satellite, scenario))
        if found is not None:
            return found
    known = sorted({key[1:] for file in (tuned, TUNED) for key in entries_of(file, "baselines.tune") if key[0] == name})
    raise NotPreparedError(
        f"{name} is not tuned for satellite {satellite!r} in scenario {scenario!r}, only for {known}; "
        "baselines.tune.tune finds settings for any satellite, satid_gym.policies.registry.build takes them"
    )
