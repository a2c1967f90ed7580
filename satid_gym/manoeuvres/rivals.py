"""Rivals of a manoeuvre on the same satellite: the paper's eight profiles and the closed loops at their best.

Each is flown with several settings on tuning seeds; the best that keeps the limits is a rival, else the one that
leaves them least. Settings with which the filter breaks down in a flight, as it may where excitation is weak, are left
out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from satid_gym.evaluation import seeds
from satid_gym.manoeuvres.request import KeepOut, Request
from satid_gym.manoeuvres.search import SLACK, Effort, Progress
from satid_gym.manoeuvres.trial import Trial, fly_side_by_side
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policy import Policy, observation_settings, only_mission
from satid_gym.problem import Problem
from satid_gym.profiles import PROFILES

_AMPLITUDES = np.geomspace(0.001, 1.0, 13)  # of the torque limit
_PERIODS = (6.0, 12.0, 24.0, 48.0)  # s
_MARGINS = (2.5, 3.5)
_SHARES, _DWELLS = (0.5, 0.9), (0.5, 2.0)
_TUNING = 6  # flights that choose settings, over those of a round of the search


def rivals(problem: Problem, request: Request, effort: Effort, progress: Progress) -> list[Trial]:
    """Trials of the rivals, each with the settings that were best for it.

    Args:
        problem: as for `search`; rivals command torque, or rates where they take nothing else.
        request: whose limit on costs they keep to; turn limits and keep-outs are told, not kept to.
        effort: how many satellites are drawn.
        progress: is told of each kind.
    """
    chosen: list[Trial] = []
    families = [("the paper's eight profiles", _scripted(), problem.replace(control="torque"))]
    families.append(("squares of rate by torque", _squares(), problem.replace(control="torque")))
    if problem.estimator.mode_count(only_mission(problem).satellite) > 0:
        shaped = problem.replace(control="rate", **observation_settings(ShapedSquarePolicy()))
        families.append(("shaped squares of rate", _shaped(), shaped))
    for what, family, world in families:
        progress(f"comparing with {what}")
        best, failed = [], 0
        for choices in family:  # one after another, for the memory of many long flights
            kept, trials = _flown(world, choices, seeds("tuning", _TUNING * effort.episodes))
            failed += len(choices) - len(kept)
            if kept:
                best.append(kept[_best(trials, request.cost_limit)])
        kept, trials = _flown(world, best, seeds("test", effort.flights), request.keep_outs)
        failed += len(best) - len(kept)
        if failed:
            progress(f"left out {failed} settings of {what}, with which the filter broke down in a flight")
        chosen += trials
    return chosen


def _flown(
    world: Problem, choices: list[Policy], flown: list[int], keep_outs: Sequence[KeepOut] = ()
) -> tuple[list[Policy], list[Trial]]:
    """Those choices with which no filter breaks down, and their trials."""
    try:
        return choices, fly_side_by_side(world, choices, flown, keep_outs) if choices else []
    except FloatingPointError:
        if len(choices) == 1:
            return [], []
    parts = [_flown(world, [choice], flown, keep_outs) for choice in choices]
    return [kept for some, _ in parts for kept in some], [trial for _, some in parts for trial in some]


def _best(trials: list[Trial], limit: float) -> int:
    limit *= SLACK
    if not any(trial.keeps(limit) for trial in trials):
        return int(np.argmin([trial.beyond + trial.terminated.mean() for trial in trials]))
    return int(np.argmin([trial.expected if trial.keeps(limit) else np.inf for trial in trials]))


def _scripted() -> Iterator[list[Policy]]:
    for name, profile in PROFILES.items():
        yield [ScriptedPolicy(name, profile, amplitude) for amplitude in _AMPLITUDES]


def _squares() -> Iterator[list[Policy]]:
    yield [RateSquarePolicy(period, margin) for period in _PERIODS for margin in _MARGINS]


def _shaped() -> Iterator[list[Policy]]:
    yield [
        ShapedSquarePolicy(period=period, share=share, dwell=dwell)
        for period in _PERIODS
        for share in _SHARES
        for dwell in _DWELLS
    ]
