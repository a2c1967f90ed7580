"""Source in C of policies that read panels and tanks: tours of the rate envelope's corners, and the shaped square."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from satid_gym.control.corners.choice import EARLY, LATE
from satid_gym.control.corners.features import SLEWS, features_of
from satid_gym.control.corners.nearest_mode import SLOWEST
from satid_gym.control.corners.tour import CAUTION, CLOSED, CORNERS, SHARE
from satid_gym.control.corners.turn_gain import HOLD
from satid_gym.control.craft import Craft
from satid_gym.control.mode_shaping import bear_many, shape_many
from satid_gym.control.observed_modes import STEPS, TINY, peaks_many, peaks_of_turns_many, pulled_many, step_lag
from satid_gym.core.observation import MODE_PARTS, MODE_PLACES
from satid_gym.flightcode.c_types import number
from satid_gym.flightcode.policy_files import PolicySource, braces, commanding, shares, template
from satid_gym.onboard.pilot import Pilot
from satid_gym.policies.corner_tour import CornerTourPolicy
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.scenario_catalogue import SCENARIOS

_OWN = ("turn_gain.h", "turn_gain.c", "corner_features.h", "corner_features.c")
_SHAPES: tuple[Callable[..., Any], ...] = (bear_many, shape_many, pulled_many)
_FORECASTS: tuple[Callable[..., Any], ...] = (peaks_of_turns_many, pulled_many)


def tour_source(pilot: Pilot, policy: LearnedPolicy | CornerTourPolicy) -> PolicySource:
    """Source of a tour of corners by a weighted sum of their features, or by waits alone.

    Raises:
        ValueError: its features have no C, or its score has several layers.
    """
    if isinstance(policy, CornerTourPolicy):
        return _source(pilot, policy.margin, {"waited": 1.0}, policy.hold, policy.share, policy.caution)
    weights, is_shaped = policy.network.weights, policy.is_shaped
    unknown = sorted(set(policy.corner_features) - set(features_of(SCENARIOS["flex"], is_shaped)))
    reasons = {
        f"its score takes {', '.join(unknown)}": unknown,
        f"its score has {len(weights)} layers": len(weights) > 1,
    }
    if any(reasons.values()):
        said = "; ".join(reason for reason, holds in reasons.items() if holds)
        raise ValueError(
            f"policy {policy.name} has no C: {said}; give a policy of agents.evolution for other scenarios than "
            "calibration, operations and wheels4, such as rigid_tour, tank_tour or panel_tour"
        )
    scored = dict(zip(policy.corner_features, weights[0][0], strict=True))
    return _source(pilot, policy.margin, scored, HOLD, SHARE, CAUTION, is_shaped)


def _source(
    pilot: Pilot,
    margin: float,
    weights: Mapping[str, float],
    hold: float,
    share: float,
    caution: float,
    is_shaped: bool = False,
) -> PolicySource:
    craft = Craft.of([pilot.mission])
    lines = [f"    X({name}, {number(float(str(weight)))}f)" for name, weight in weights.items()]
    text = " \\\n".join(["/* Weights of the score. */\n#define SCORE(X)", *lines]) + "\n"
    source = PolicySource(
        template="policy_corner_tour.c",
        files={"corners.h": text, **{name: template(name) for name in _OWN}},
        state="    double side[3], waited[3]; /* s */",
    )
    rows = ", ".join(braces(row) for row in craft.inertia[0])
    source.numbers |= {"INERTIA": f"{{{rows}}}", "MOMENTUM": braces(craft.momentum[0])}
    source.numbers |= {"SHARES": shares(pilot, margin), "CLOSED": number(CLOSED)}
    numbers = {"NOISE": float(craft.noise[0]), "HOLD": hold, "SLEWS": SLEWS, "EARLY": EARLY, "LATE": LATE}
    source.numbers |= {f"TURN_{name}": number(value) for name, value in numbers.items()}
    if pilot.mission.satellite.modes:
        _read_modes(pilot, source, share, caution)
        turns = pilot.problem.scenario.tracking_bandwidth * pilot.problem.scenario.decision_period
        source.numbers |= {"SLOWEST": number(SLOWEST), "LAG": number(step_lag(turns))}
        kept = any("kept" in name for name in weights)
        takes = {"SHAPED": is_shaped, "PEAK_3": "peak_3" in weights, "PEAK_KEPT": kept}
        source.numbers |= {name: str(int(holds)) for name, holds in takes.items()}
        functions = _SHAPES if is_shaped else (*_FORECASTS, *[peaks_many] * kept)
        source.mode_functions, source.choices = functions, len(CORNERS)
    return source


def shaped_square_source(pilot: Pilot, policy: ShapedSquarePolicy) -> PolicySource:
    """Source of the square wave that spares the modes."""
    state = "    double phase[3], reference[1][3];"
    source = commanding(pilot, PolicySource(template="policy_shaped_square.c", state=state), policy.margin)
    _read_modes(pilot, source, policy.share, policy.caution)
    source.numbers |= {name.upper(): number(getattr(policy, name)) for name in ("period", "dwell", "amplitude")}
    source.mode_functions, source.choices = (shape_many,), 1
    return source


def _read_modes(pilot: Pilot, source: PolicySource, share: float, caution: float) -> None:
    """Add what reading the modes takes."""
    source.state += "\n    satid_mode_sheet sheet;"
    source.numbers |= {"SHARE": number(share), "CAUTION": number(caution), "TINY": number(TINY), "STEPS": str(STEPS)}
    source.numbers["MOMENTS"] = braces(np.diag(pilot.mission.prior.inertia))
    source.numbers |= {f"MODE_{name.upper()}": str(place) for name, place in MODE_PLACES.items()}
    source.numbers["MODE_PARTS"] = str(sum(MODE_PARTS.values()))
