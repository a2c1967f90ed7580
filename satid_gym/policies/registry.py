"""Registry of the baselines by name, with the settings that `python -m baselines.tune` found for them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from satid_gym.config import unknown_name
from satid_gym.policies import grids
from satid_gym.policies.clear_square import ClearSquarePolicy
from satid_gym.policies.corner_tour import CornerTourPolicy
from satid_gym.policies.filter_mpc import FilterMPCPolicy
from satid_gym.policies.greedy import GreedyPolicy
from satid_gym.policies.lookahead import LookaheadPolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policies.open_loop_optimal import (
    DESIGNS,
    PREPARED_AS,
    NotPreparedError,
    OpenLoopOptimalPolicy,
    design_of,
    entries_of,
)
from satid_gym.policies.operator import OperatorPolicy
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import RandomPolicy, ZeroPolicy
from satid_gym.policies.scripted import ScriptedPolicy, staggered_square
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policies.swing_and_stop import SwingAndStopPolicy
from satid_gym.policies.swing_between import SwingBetweenPolicy
from satid_gym.policy import Policy
from satid_gym.profiles import PROFILES

TUNED = Path(__file__).with_name("tuned.json")


def _staggered_square(amplitude: float, period: float) -> ScriptedPolicy:
    return ScriptedPolicy("staggered_square", functools.partial(staggered_square, period=period), amplitude)


def _spared_square(period: float = 12.0, margin: float = 3.5) -> RateSquarePolicy:
    return RateSquarePolicy(period, margin, spares_modes=True)


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """Entry of the registry.

    Attributes:
        make: builds the policy from its settings.
        grid: settings that `baselines.tune` tries, see `satid_gym.policies.grids`; a baseline that is tuned needs one.
        tuned: whether `baselines.tune` finds its settings; False for one that has none, or is designed in another way.
        planner: whether it plans ahead in each decision: its flights take most of a comparison's time, so it is
            tuned on fewer episodes, and `agents.compare` flies it only with `--all`.
    """

    make: Callable[..., Policy]
    grid: grids.Grid | None = None
    tuned: bool = True
    planner: bool = False


def _planner(make: Callable[..., Policy]) -> Baseline:
    return Baseline(make=make, grid=grids.planner, planner=True)


BASELINES: dict[str, Baseline] = {
    **{
        name: Baseline(make=functools.partial(ScriptedPolicy, name, profile), grid=grids.paper_profile(name))
        for name, profile in PROFILES.items()  # the paper's eight; a signal of your own is an entry below, not of these
    },
    "staggered_square": Baseline(make=_staggered_square, grid=grids.staggered_square),
    "open_loop_optimal": Baseline(make=OpenLoopOptimalPolicy, tuned=False),  # has designs
    "rate_square": Baseline(make=RateSquarePolicy, grid=grids.rate_square),
    "greedy": _planner(functools.partial(GreedyPolicy, "greedy", 1)),
    "greedy_horizon": _planner(functools.partial(GreedyPolicy, "greedy_horizon", 8)),
    "mpc": _planner(MPCPolicy),
    "random": Baseline(make=RandomPolicy, tuned=False),
    "zero": Baseline(make=ZeroPolicy, tuned=False),
}
RATE_BASELINES: dict[str, Baseline] = {
    "shaped_square": Baseline(make=ShapedSquarePolicy, tuned=False),
    "spared_square": Baseline(make=_spared_square, tuned=False),
    "corner_tour": Baseline(make=CornerTourPolicy, tuned=False),
    "swing_and_stop": Baseline(make=SwingAndStopPolicy, tuned=False),
    "filter_mpc": Baseline(make=FilterMPCPolicy, tuned=False, planner=True),
    "lookahead": Baseline(make=LookaheadPolicy, tuned=False, planner=True),
    "operator": Baseline(make=OperatorPolicy, tuned=False),
    "swing_between": Baseline(make=SwingBetweenPolicy, tuned=False),
    "clear_square": Baseline(make=ClearSquarePolicy, tuned=False),
}
"""Baselines for `control="rate"` alone; comparisons, which fly torques, leave them out."""
PLANNERS = tuple(name for name, baseline in BASELINES.items() if baseline.planner)
RATE_PLANNERS = tuple(name for name, baseline in RATE_BASELINES.items() if baseline.planner)


def build(name: str, settings: dict[str, float]) -> Policy:
    """Baseline with given settings.

    Raises:
        ValueError: the name is unknown or a setting is not valid.
        TypeError: a setting is missing or unknown.
    """
    return _entry(name).make(**settings)


def _entry(name: str) -> Baseline:
    known = {**BASELINES, **RATE_BASELINES}
    if name not in known:
        raise unknown_name("baseline", name, known)
    return known[name]


def make_baseline(
    name: str, satellite: str, scenario: str = "default", *, tuned: Path = TUNED, designs: Path = DESIGNS
) -> Policy:
    """Baseline with the settings tuned for a satellite in a scenario.

    Args:
        name: name of the baseline.
        satellite, scenario: their names.
        tuned: file of `python -m baselines.tune`; settings that it lacks are taken from the shipped file.
        designs: file of `python -m baselines.tuning.open_loop_design`, likewise.

    Raises:
        ValueError: the name is unknown, or no settings are stored for that satellite and scenario.
    """
    if name == OpenLoopOptimalPolicy.name:
        design = design_of(satellite, scenario, designs)
        return OpenLoopOptimalPolicy(design["dwell"], design["fraction"])
    if not _entry(name).tuned:
        return build(name, {})
    return build(name, tuned_entry(name, satellite, scenario, tuned)["settings"])


def tuned_entry(name: str, satellite: str, scenario: str = "default", tuned: Path = TUNED) -> dict[str, Any]:
    """Settings of a baseline and their score in tuning; arguments as of `make_baseline`.

    Raises:
        ValueError: the name is unknown, or it was not tuned for that satellite and scenario.
    """
    _entry(name)
    scenario = PREPARED_AS.get(scenario, scenario)
    for file in (tuned, TUNED):
        found = entries_of(file, "baselines.tune").get((name, satellite, scenario))
        if found is not None:
            return found
    known = sorted({key[1:] for file in (tuned, TUNED) for key in entries_of(file, "baselines.tune") if key[0] == name})
    raise NotPreparedError(
        f"{name} is not tuned for satellite {satellite!r} in scenario {scenario!r}, only for {known}; "
        "python -m baselines.tune finds settings for any satellite, satid_gym.policies.registry.build takes them"
    )
