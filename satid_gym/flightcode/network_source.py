"""Source of a network in C: its layers, and for how many decisions a command of it is repeated."""

from __future__ import annotations

import numpy as np

from satid_gym.flightcode.c_types import number
from satid_gym.flightcode.layout import lines_of
from satid_gym.flightcode.policy_files import PolicySource, commanding
from satid_gym.onboard.pilot import Pilot
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.principal import fitted


def network_source(pilot: Pilot, policy: LearnedPolicy) -> PolicySource:
    """Source of a network from observation to command.

    Raises:
        ValueError: what becomes of its command has no C.
    """
    if policy.spares_modes:
        raise ValueError(f"policy {policy.name} spares modes by a law that has no C: give a learned policy without")
    network = fitted(policy.network, pilot.mission.layout)
    sizes = [network.weights[0].shape[1], *(weight.shape[0] for weight in network.weights)]
    text = "\n".join(
        [
            "/* Layers of the network: their sizes, and weights and biases one layer after another, row by row. */",
            f"#define REPEAT {policy.repeat} /* decisions */",
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
    state = f"    int32_t decision;\n    double command[{sizes[-1]}];"
    source = PolicySource(template="policy_network.c", state=state, files={"network.h": text})
    if policy.control == "rate":
        return commanding(pilot, source, policy.margin)
    source.numbers["COMMAND_IS_RATE"] = "0"
    return source


def _floats(name: str, values: np.ndarray) -> str:
    numbers = ", ".join(f"{number(float(str(value)))}f" for value in values)  # the shortest that reads as the same
    return lines_of(f"static const float {name}[{len(values)}] = {{\n    {numbers}}};")
