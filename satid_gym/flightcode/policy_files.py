"""Files of a policy in C: its template, its numbers and what is translated for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import numpy as np

from satid_gym.control.decoded_observation import PlantConstants
from satid_gym.control.rate_loop import RateMargin
from satid_gym.flightcode.c_types import number
from satid_gym.onboard.pilot import Pilot

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
        mode_functions: of observed modes, which it calls, to be translated.
        choices: how many rates these are given at once.
    """

    template: str
    numbers: dict[str, str] = field(default_factory=dict)
    state: str = _COUNTER
    files: dict[str, str] = field(default_factory=dict)
    constants: PlantConstants | None = None
    mode_functions: tuple[Callable[..., Any], ...] = ()
    choices: int = 0

    def texts(self) -> dict[str, str]:
        """All files by name."""
        lines = [f"#define SATID_{name} {value}" for name, value in self.numbers.items()]
        include = '#include "modes.h"\n' if self.mode_functions else ""
        header = _HEADER.format(include, "\n".join(lines), self.state)
        own = {self.template: template(self.template), "satid_policy.h": header}
        if "COMMAND_IS_RATE" in self.numbers:
            own["command.h"] = template("command.h")
        if self.constants is not None:
            own |= {name: template(name) for name in ("rate_loop.h", "rate_loop.c")}
        if self.mode_functions:
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


def commanding(pilot: Pilot, source: PolicySource, margin: float) -> PolicySource:
    """Source of a policy that commands body rates, with the conversion of rates to actions."""
    source.numbers["COMMAND_IS_RATE"] = "1"
    if pilot.problem.control == "torque":
        source.constants = PlantConstants.of([pilot.mission])
        source.numbers["MARGIN"] = number(margin)
    else:
        source.numbers["SHARES"] = shares(pilot, margin)
    return source


def shares(pilot: Pilot, margin: float) -> str:
    """Shares of the rate limit that noise leaves, about each axis."""
    return braces(RateMargin([pilot.mission], margin)(np.zeros((1, 1)), np.ones((1, 3)))[0])


def braces(values: np.ndarray) -> str:
    """Initialiser of an array."""
    return "{" + ", ".join(number(float(value)) for value in values) + "}"
