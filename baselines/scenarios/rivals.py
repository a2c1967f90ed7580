"""Rivals in a gate: the policies, the settings that are tried of each, and the rule that chooses among them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.in_the_gaps import InTheGaps
from satid_gym.appendages import Panels
from satid_gym.evaluation import seeds
from satid_gym.policies.clear_square import ClearSquarePolicy
from satid_gym.policies.corner_tour import CornerTourPolicy
from satid_gym.policies.filter_mpc import FilterMPCPolicy
from satid_gym.policies.lookahead import LookaheadPolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policies.operator import OperatorPolicy
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import RandomPolicy, ZeroPolicy
from satid_gym.policies.registry import build
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policies.swing_and_stop import SwingAndStopPolicy
from satid_gym.policies.swing_between import SwingBetweenPolicy
from satid_gym.policy import Policy, observation_settings
from satid_gym.profiles import PROFILES
from satid_gym.scenario_catalogue import SCENARIOS

Trial = tuple[dict[str, Any], Policy]
AMPLITUDES = np.geomspace(0.01, 0.95, 20).round(3).tolist()  # of the rate limit
_COARSE = 3  # step through the amplitudes where episodes are long: 0.013 to 0.95, a factor of 2 apart
_INSIDE = -1.0  # ranks before any share of episodes that ended
PERIODS = (12.0, 24.0, 48.0, 96.0, 192.0)  # s
SPARED = (8.0, 12.0, 16.0, 24.0, 48.0)  # s, periods of `spared_square`
SHAPES = [
    {"period": period, "share": share, "dwell": dwell, "amplitude": amplitude}
    for period in (12.0, 24.0, 48.0)
    for share in (0.35, 0.5, 0.65, 0.8, 0.9, 1.0)
    for dwell in (0.0, 0.5, 1.0)
    for amplitude in (0.7, 1.0)
]
HOLDS = (4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 14.0)  # s, of `corner_tour`
SETTLES = (4.0, 5.0)  # s; of what flies in the gaps with 3 most misses windows on cubesat for over 1 % of the time
BETWEEN = [
    {"swing": swing, "roll": roll, "settle": settle}
    for swing in (3.0, 4.0, 6.0, 9.0)
    for roll in (0.0, 1.0)
    for settle in SETTLES
]
CLEAR = [{"period": period, "room": room} for period in (8.0, 10.0, 12.0, 16.0) for room in (0.0, 1.0, 2.0, 5.0)]
QUIET_PLANS: list[dict[str, Any]] = [
    {"horizon": 30, "edits": 60, "margin": 3.5, "amplitude": amplitude, "clearance": clearance}
    for amplitude in (0.5, 0.6, 0.7, 0.8, 1.0)
    for clearance in (0.02, 0.06)
]
SWINGS = [
    {"swing": swing, "look": look, "amplitude": amplitude}
    for swing in (6.0, 8.0, 12.0, 16.0)
    for look in (1.0, 2.0, 4.0)
    for amplitude in (0.7, 1.0)
]


def rivals(scenario: str) -> dict[str, list[Trial]]:
    """Settings to try of each policy, by its name."""
    amplitudes = AMPLITUDES[1::_COARSE] if _has_tracker(scenario) else AMPLITUDES
    loud: dict[str, list[Trial]] = {
        name: [({"amplitude": a}, ScriptedPolicy(name, profile, a)) for a in amplitudes]
        for name, profile in PROFILES.items()
    }
    squares: list[Trial] = [
        ({"period": period, "amplitude": a}, Quieter(RateSquarePolicy(period, 3.5), a))
        for period in PERIODS
        for a in amplitudes
    ]
    spared: list[Trial] = [({"period": period}, build("spared_square", {"period": period})) for period in SPARED]
    toured: list[Trial] = [({"hold": hold}, CornerTourPolicy(hold)) for hold in HOLDS]
    shaped: list[Trial] = [(shape, ShapedSquarePolicy(**shape)) for shape in SHAPES]
    rehearsed: list[Trial] = [(given, FilterMPCPolicy(**given)) for given in _rehearsals(scenario)]
    planned: dict[str, list[Trial]] = {name: [({}, build(name, {"margin": 3.5}))] for name in ("greedy", "mpc")}
    swings: list[Trial] = [(swing, SwingAndStopPolicy(**swing)) for swing in SWINGS]
    still: dict[str, list[Trial]] = {"zero": [({}, ZeroPolicy())], "random": [({}, RandomPolicy())]}
    if SCENARIOS[scenario].operations is not None:
        between: dict[str, list[Trial]] = {**loud, "rate_square": squares, **planned, "filter_mpc": rehearsed}
        return {
            **still,
            "operator": [({"settle": settle}, OperatorPolicy(settle)) for settle in SETTLES],
            **{name: _in_the_gaps(trials) for name, trials in between.items()},
            "swing_between": [(own, SwingBetweenPolicy(**own)) for own in BETWEEN],
            "lookahead": _lookaheads(scenario),
        }
    plain = {**still, **loud, "rate_square": squares}
    if SCENARIOS[scenario].wheels is not None:
        quiet: list[Trial] = [(own, MPCPolicy(**own)) for own in QUIET_PLANS]
        return {**plain, "clear_square": [(own, ClearSquarePolicy(**own)) for own in CLEAR], "mpc": quiet}
    if _has_limit(scenario):
        shapes = {"spared_square": spared, "shaped_square": shaped, "corner_tour": toured}
        return {**plain, **shapes, "filter_mpc": rehearsed, "lookahead": _lookaheads(scenario)}
    if _has_tracker(scenario):
        return {
            **plain,
            "swing_and_stop": swings,
            **planned,
            "filter_mpc": rehearsed,
            "lookahead": _lookaheads(scenario),
        }
    return {**plain, **planned}


def _in_the_gaps(trials: Sequence[Trial]) -> list[Trial]:
    return [({**own, "settle": settle}, InTheGaps(policy, settle)) for own, policy in trials for settle in SETTLES]


def _rehearsals(scenario: str) -> list[dict[str, Any]]:
    """Settings of `filter_mpc` to try: certainty-equivalent with no caution."""
    if _has_tracker(scenario):  # more edits, or more readings, take more than 5 ms a decision
        return [{"horizon": 40, "edits": 16}, {"horizon": 60, "edits": 20, "step": 1.0}]
    return [
        {"horizon": 16, "edits": 24, "tail": 5.0, "caution": caution, "amplitude": amplitude}
        for caution in (0.0, 1.0, 2.0)
        for amplitude in (0.7, 1.0)
    ]


def _lookaheads(scenario: str) -> list[Trial]:
    """Settings of `lookahead` to try, with a learned policy that fits the scenario."""
    if SCENARIOS[scenario].operations is not None:
        given: list[dict[str, Any]] = [{"policy": "window_tour", "horizon": 20, "settle": settle} for settle in SETTLES]
    elif _has_tracker(scenario):
        given = [
            {"policy": "stargazer", "horizon": 60, "edits": edits, "step": step}
            for edits, step in ((48, 1.0), (24, 0.5))
        ]
    else:
        has_panels = isinstance(SCENARIOS[scenario].appendages, Panels)  # edits bend panels too far
        given = [
            {
                "policy": "panel_tour" if has_panels else "tank_tour",
                "horizon": 16,
                "tail": 5.0,
                "edits": edits,
                "caution": caution,
            }
            for edits in ((0,) if has_panels else (0, 24))
            for caution in (0.0, 1.0, 2.0)
        ]
    return [(own, LookaheadPolicy(**own)) for own in given]


def _has_limit(scenario: str) -> bool:
    appendages = SCENARIOS[scenario].appendages
    return appendages is not None and appendages.deflection_limit is not None


def _has_tracker(scenario: str) -> bool:
    sensors = SCENARIOS[scenario].sensors
    return sensors is not None and sensors.star_tracker is not None


class Quieter:
    """A policy whose actions are multiplied by a factor; it takes the same observations."""

    def __init__(self, policy: Policy, factor: float) -> None:
        self.name, self.kind = policy.name, policy.kind
        vars(self).update(observation_settings(policy))
        self._policy, self._factor = policy, factor

    def reset(self, mission: Any, seeds: Sequence[int]) -> None:
        """Prepare the policy."""
        self._policy.reset(mission, seeds)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Its action, times the factor."""
        return self._factor * self._policy(observation)


def choose(
    cell: Cell, trials: Sequence[Trial], limit: float, episodes: int, *, num_threads: int | None = None
) -> Trial:
    """Settings with the least expected error on tuning seeds, of those inside the limit (see `Flown.inside`); where
    none are, of those under which the fewest episodes end early the ones that cost least."""
    if len(trials) == 1:
        return trials[0]
    judged: list[tuple[float, float, int]] = []
    for i, (_, policy) in enumerate(trials):
        flight = flown(cell, policy, seeds("tuning", episodes), num_threads=num_threads)
        if flight.inside(limit):
            judged.append((_INSIDE, float(flight.expected.mean()), i))
        else:
            judged.append((float(flight.terminated.mean()), float(flight.costs.mean(axis=0).max()), i))
    return trials[min(judged)[2]]
