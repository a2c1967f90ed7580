"""Source of a policy in C: its template and its numbers."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import numpy as np

from satid_gym.control.corners.choice import EARLY, LATE, SLOWEST
from satid_gym.control.corners.features import SLEWS, features_of
from satid_gym.control.corners.tour import CAUTION, CORNERS, SHARE
from satid_gym.control.corners.turn_gain import HOLD
from satid_gym.control.craft import Craft
from satid_gym.control.decoded_observation import PlantConstants
from satid_gym.control.mode_shaping import bear_many, shape_many
from satid_gym.control.observed_modes import TINY, pulled_many
from satid_gym.control.rate_loop import RateMargin
from satid_gym.core.observation import MODE_PARTS, MODE_PLACES
from satid_gym.flightcode.c_types import number
from satid_gym.flightcode.layout import lines_of
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.onboard.pilot import Pilot
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.principal import fitted
from satid_gym.policies.open_loop_optimal import OpenLoopOptimalPolicy
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import RandomPolicy, ZeroPolicy
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.scenario_catalogue import SCENARIOS

_SCRIPTS = (ScriptedPolicy, OpenLoopOptimalPolicy, ManoeuvrePolicy, RandomPolicy, ZeroPolicy)
_COUNTER = "    int32_t decision;"


@dataclass(kw_only=True)
class PolicySource:
    """Files of a policy.

    Attributes:
        template: name of its source file.
        numbers: macros of satid_policy.h by name, without SATID_.
        state: lines of its struct.
        files: texts of files of its own, by name.
        constants: of the satellite, where its commands are brought to wheel torque once a decision.
        shaping: functions of observed modes that it calls, to be translated.
        choices: how many rates these are given at once.
    """

    template: str
    numbers: dict[str, str] = field(default_factory=dict)
    state: str = _COUNTER
    files: dict[str, str] = field(default_factory=dict)
    constants: PlantConstants | None = None
    shaping: tuple[Callable[..., Any], ...] = ()
    choices: int = 0

    def texts(self) -> dict[str, str]:
        """All files by name."""
        lines = [f"#define SATID_{name} {value}" for name, value in self.numbers.items()]
        include = '#include "modes.h"\n' if self.shaping else ""
        header = _HEADER.format(include, "\n".join(lines), self.state)
        own = {self.template: template(self.template), "satid_policy.h": header}
        if "COMMAND_IS_RATE" in self.numbers:
            own["command.h"] = template("command.h")
        if self.constants is not None:
            own |= {name: template(name) for name in ("rate_loop.h", "rate_loop.c")}
        if self.shaping:
            own |= {name: template(name) for name in ("modes.h", "modes.c")}
        return own | self.files


_HEADER = """/* Policy: what it remembers, and its action for an observation. */
#ifndef SATID_POLICY_H
#define SATID_POLICY_H

#include "satid_core.h"
{}
{}

typedef struct {{
{}
}} satid_policy;

void satid_policy_reset(satid_policy *policy);

/* Action in [-1, 1]: torque of each wheel over its limit, or body rate over its limit. */
void satid_policy_act(satid_policy *policy, const float observation[SATID_OBSERVATION], double action[SATID_ACTIONS]);

#endif
"""


def template(name: str) -> str:
    """Text of a file of the package."""
    return files("satid_gym.flightcode").joinpath("c", name).read_text(encoding="utf-8")


def policy_source(pilot: Pilot) -> PolicySource:
    """Source of the policy that a pilot flies.

    Raises:
        ValueError: it plans, or is of a kind that has no C.
    """
    policy = pilot.policy
    known = (LearnedPolicy, RateSquarePolicy, ShapedSquarePolicy, *_SCRIPTS)
    if isinstance(policy, known) and type(policy) not in known:
        raise ValueError(
            f"policy {policy.name} is a {type(policy).__name__} of its own, and has no C: give one of the library's"
        )
    if isinstance(policy, LearnedPolicy):
        return _learned(pilot, policy)
    if isinstance(policy, RateSquarePolicy):
        source = _commanding(pilot, PolicySource(template="policy_rate_square.c"), policy.margin)
        source.numbers["PERIOD"] = number(policy.period)
        return source
    if isinstance(policy, ShapedSquarePolicy):
        return _shaped(pilot, policy)
    if isinstance(policy, _SCRIPTS):
        return _script(pilot)
    raise ValueError(
        f"policy {policy.name} has no C: give a learned policy, rate_square, shaped_square or one with a script; those "
        "that plan (greedy, mpc) take too long for a flight computer"
    )


def _commanding(pilot: Pilot, source: PolicySource, margin: float) -> PolicySource:
    """Source of a policy that commands body rates, with the conversion of rates to actions."""
    source.numbers["COMMAND_IS_RATE"] = "1"
    if pilot.problem.control == "torque":
        source.constants = PlantConstants.of([pilot.mission])
        source.numbers["MARGIN"] = number(margin)
    else:
        source.numbers["SHARES"] = _shares(pilot, margin)
    return source


def _shares(pilot: Pilot, margin: float) -> str:
    return _braces(RateMargin([pilot.mission], margin)(np.zeros((1, 1)), np.ones((1, 3)))[0])


def _learned(pilot: Pilot, policy: LearnedPolicy) -> PolicySource:
    if policy.spares_modes:
        raise ValueError(f"policy {policy.name} spares modes by a law that has no C: give a learned policy without")
    if policy.corner_features:
        return _tour(pilot, policy)
    if policy.repeat > 1:
        raise ValueError(
            f"policy {policy.name} repeats each command for {policy.repeat} decisions, and has no C: give a learned "
            "policy that decides each time"
        )
    network = fitted(policy.network, pilot.mission.layout)
    sizes = [network.weights[0].shape[1], *(weight.shape[0] for weight in network.weights)]
    text = "\n".join(
        [
            "/* Layers of the network: their sizes, and weights and biases one layer after another, row by row. */",
            f"#define LAYERS {len(network.weights)}",
            f"#define WIDEST {max(sizes)}",
            f"#define ACTIVATION(x) {'tanh(x)' if network.activation == 'tanh' else 'fmax(x, 0.0)'}",
            f"#define SQUASH(x) {'tanh(x)' if network.squashed else '(x)'}\n",
            f"static const int SIZES[LAYERS + 1] = {{{', '.join(map(str, sizes))}}};",
            _floats("WEIGHTS", np.concatenate([weight.ravel() for weight in network.weights])),
            _floats("BIASES", np.concatenate(network.biases)),
            "",
        ]
    )
    source = PolicySource(template="policy_network.c", files={"network.h": text})
    if policy.control == "rate":
        return _commanding(pilot, source, policy.margin)
    source.numbers["COMMAND_IS_RATE"] = "0"
    return source


def _tour(pilot: Pilot, policy: LearnedPolicy) -> PolicySource:
    satellite, weights = pilot.mission.satellite, policy.network.weights
    unknown = sorted(set(policy.corner_features) - set(features_of(SCENARIOS["flex"], is_shaped=True)))
    reasons = {
        f"its score takes {', '.join(unknown)}": unknown,
        f"its score has {len(weights)} layers": len(weights) > 1,
        f"it is not shaped, and {satellite.name} has panels or tanks": satellite.modes and not policy.is_shaped,
    }
    if any(reasons.values()):
        said = "; ".join(reason for reason, holds in reasons.items() if holds)
        raise ValueError(
            f"policy {policy.name} has no C for {satellite.name}: {said}; "
            "give a policy of agents.evolution --shaped, such as panel_tour, or shaped_square"
        )
    craft = Craft.of([pilot.mission])
    scored = zip(policy.corner_features, weights[0][0], strict=True)
    lines = [f"    X({name}, {number(float(str(weight)))}f)" for name, weight in scored]
    text = " \\\n".join(["/* Weights of the score. */\n#define SCORE(X)", *lines]) + "\n"
    own = ("turn_gain.h", "turn_gain.c", "corner_features.h", "corner_features.c")
    source = PolicySource(
        template="policy_corner_tour.c",
        files={"corners.h": text, **{name: template(name) for name in own}},
        state="    double side[3], waited[3]; /* s */",
    )
    rows = ", ".join(_braces(row) for row in craft.inertia[0])
    source.numbers |= {"INERTIA": f"{{{rows}}}", "MOMENTUM": _braces(craft.momentum[0])}
    source.numbers["SHARES"] = _shares(pilot, policy.margin)
    numbers = {"NOISE": float(craft.noise[0]), "HOLD": HOLD, "SLEWS": SLEWS, "EARLY": EARLY, "LATE": LATE}
    source.numbers |= {f"TURN_{name}": number(value) for name, value in numbers.items()}
    if satellite.modes:  # else shaping does nothing
        _spare_modes(pilot, source, SHARE, CAUTION)
        source.numbers["SLOWEST"] = number(SLOWEST)
        source.shaping, source.choices = (bear_many, shape_many, pulled_many), len(CORNERS)
    return source


def _shaped(pilot: Pilot, policy: ShapedSquarePolicy) -> PolicySource:
    state = "    double phase[3], reference[1][3];"
    source = _commanding(pilot, PolicySource(template="policy_shaped_square.c", state=state), policy.margin)
    _spare_modes(pilot, source, policy.share, policy.caution)
    source.numbers |= {name.upper(): number(getattr(policy, name)) for name in ("period", "dwell", "amplitude")}
    source.shaping, source.choices = (shape_many,), 1
    return source


def _spare_modes(pilot: Pilot, source: PolicySource, share: float, caution: float) -> None:
    """Add what reading the modes takes."""
    source.state += "\n    satid_mode_sheet sheet;"
    source.numbers |= {"SHARE": number(share), "CAUTION": number(caution), "TINY": number(TINY)}
    source.numbers["MOMENTS"] = _braces(np.diag(pilot.mission.prior.inertia))
    source.numbers |= {f"MODE_{name.upper()}": str(place) for name, place in MODE_PLACES.items()}
    source.numbers["MODE_PARTS"] = str(sum(MODE_PARTS.values()))


def _script(pilot: Pilot) -> PolicySource:
    size = max(place.stop for place in pilot.problem.layout.values())
    policy = copy.deepcopy(pilot.policy)  # one that is flying keeps its place
    policy.reset(pilot.mission, [pilot.seed])
    rows = [policy(np.zeros((1, size), np.float32))[0] for _ in range(pilot.problem.scenario.decisions)]
    head = "/* Action of each decision. */\nstatic const double SCRIPT[SATID_DECISIONS][SATID_ACTIONS] = {\n"
    body = "".join(f"    {_braces(row)},\n" for row in rows)
    return PolicySource(template="policy_script.c", files={"script.h": f"{head}{body}}};\n"})


def _braces(values: np.ndarray) -> str:
    return "{" + ", ".join(number(float(value)) for value in values) + "}"


def _floats(name: str, values: np.ndarray) -> str:
    numbers = ", ".join(f"{number(float(str(value)))}f" for value in values)  # the shortest that reads as the same
    return lines_of(f"static const float {name}[{len(values)}] = {{\n    {numbers}}};")
