"""Source of a policy in C, by its kind."""

from __future__ import annotations

import copy

import numpy as np

from satid_gym.flightcode.c_types import number
from satid_gym.flightcode.network_source import network_source
from satid_gym.flightcode.policy_files import PolicySource, braces, commanding
from satid_gym.flightcode.tour_source import shaped_square_source, tour_source
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.onboard.pilot import Pilot
from satid_gym.policies.corner_tour import CornerTourPolicy
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.open_loop_optimal import OpenLoopOptimalPolicy
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import RandomPolicy, ZeroPolicy
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy

_SCRIPTS = (ScriptedPolicy, OpenLoopOptimalPolicy, ManoeuvrePolicy, RandomPolicy, ZeroPolicy)


def policy_source(pilot: Pilot) -> PolicySource:
    """Source of the policy that a pilot flies.

    Raises:
        ValueError: it plans, or is of a kind that has no C.
    """
    policy = pilot.policy
    known = (LearnedPolicy, RateSquarePolicy, ShapedSquarePolicy, CornerTourPolicy, *_SCRIPTS)
    if isinstance(policy, known) and type(policy) not in known:
        raise ValueError(
            f"policy {policy.name} is a {type(policy).__name__} of its own, and has no C: give one of the library's"
        )
    if isinstance(policy, LearnedPolicy):
        return (tour_source if policy.corner_features else network_source)(pilot, policy)
    if isinstance(policy, RateSquarePolicy):
        source = commanding(pilot, PolicySource(template="policy_rate_square.c"), policy.margin)
        source.numbers["PERIOD"] = number(policy.period)
        return source
    if isinstance(policy, ShapedSquarePolicy):
        return shaped_square_source(pilot, policy)
    if isinstance(policy, CornerTourPolicy):
        return tour_source(pilot, policy)
    if isinstance(policy, _SCRIPTS):
        return _script(pilot)
    raise ValueError(
        f"policy {policy.name} has no C: give a learned policy, rate_square, shaped_square, corner_tour or one with a "
        "script; those that plan (greedy, mpc) take too long for a flight computer"
    )


def _script(pilot: Pilot) -> PolicySource:
    size = max(place.stop for place in pilot.problem.layout.values())
    policy = copy.deepcopy(pilot.policy)  # one that is flying keeps its place
    policy.reset(pilot.mission, [pilot.seed])
    rows = [policy(np.zeros((1, size), np.float32))[0] for _ in range(pilot.problem.scenario.decisions)]
    head = "/* Action of each decision. */\nstatic const double SCRIPT[SATID_DECISIONS][SATID_ACTIONS] = {\n"
    body = "".join(f"    {braces(row)},\n" for row in rows)
    return PolicySource(template="policy_script.c", files={"script.h": f"{head}{body}}};\n"})
