"""Export a policy to one ONNX graph: `python -m agents.export POLICY OUTPUT.onnx --satellite NAME`.

The graph takes observations (N, size), float32, and gives actions (N, n), the motors' torque over its limits: the
observation in physical units, the network and the rate loop are in it, for one satellite's data sheet. With
control="rate" an action is the body rate (N, 3) over its limit. A row of observations that is not finite gives no
torque. It is checked against the policy's own actions, on a flight's observations, before it is kept.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import onnx
import onnxruntime
import tyro
from onnx import TensorProto, helper

from agents.training.graph.kernels import Interpreter
from agents.training.graph.rows import Builder, Row
from baselines.command import cli
from satid_gym.control.decoded_observation import Belief, PlantConstants
from satid_gym.control.rate_loop import RateMargin, drive_many
from satid_gym.core.observation import observed_std
from satid_gym.estimators.inertia import PRODUCTS
from satid_gym.files import write_bytes
from satid_gym.fleet import Fleet
from satid_gym.gym_api import seed_stream
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.learned.principal import fitted
from satid_gym.policies.learned.shipped import find
from satid_gym.policy import Mission, missions, observation_settings
from satid_gym.problem import Problem, problem

TOLERANCE = 1e-6
_OPSET = 17
_OPERATORS = {"tanh": "Tanh", "relu": "Relu"}


def graph(policy: LearnedPolicy, mission: Mission) -> onnx.ModelProto:
    """The policy with its rate loop for one satellite as an ONNX model.

    Raises:
        ValueError: it repeats its commands; a graph keeps no count of decisions.
    """
    if policy.spares_modes or policy.corner_features:
        raise ValueError(
            f"policy {policy.name} spares modes or tours corners, by a law outside its network, which no graph holds"
        )
    if policy.repeat > 1:
        raise ValueError(
            f"policy {policy.name} repeats each command for {policy.repeat} decisions, which a graph without memory "
            "cannot: export a policy that decides each time"
        )
    network = fitted(policy.network, mission.layout)
    builder, size = Builder(), network.weights[0].shape[1]
    infinite, nan = builder.add("IsInf", "observation"), builder.add("IsNaN", "observation")
    wrong = builder.add("Or", infinite, nan)
    zero = builder.constant(np.float32(0.0))
    seen = builder.add("Where", wrong, zero, "observation")
    command = _network(builder, network, builder.add("Cast", seen, to=TensorProto.DOUBLE))
    if policy.control == "rate":
        batch = _columns(builder, seen, 1)[0] * 0.0
        rates = _columns(builder, command, 3)
        if mission.control == "torque":
            parts = _rate_loop(builder, batch, _columns(builder, seen, size), rates, policy.margin, mission)
        else:
            shares = RateMargin([mission], policy.margin)(np.zeros((1, 1)), np.ones((1, 3)))[0]
            parts = [rate * float(share) for rate, share in zip(rates, shares, strict=True)]
        axis = builder.constant(np.array([1]))
        command = builder.add("Concat", *(builder.add("Unsqueeze", part.name, axis) for part in parts), axis=1)
    counts = builder.add("ReduceMax", builder.add("Cast", wrong, to=TensorProto.FLOAT), axes=[1], keepdims=1)
    lost = builder.add("Greater", counts, zero)
    action = builder.add("Where", lost, builder.constant(np.float64(0.0)), command)
    builder.nodes.append(helper.make_node("Cast", [action], ["action"], to=TensorProto.FLOAT))
    model = helper.make_model(
        helper.make_graph(
            builder.nodes,
            policy.name,
            [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", size])],
            [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", mission.actions])],
            list(builder.constants.values()),
        ),
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=8,
    )
    props = {
        "satellite": mission.satellite.name,
        "scenario": mission.scenario.name,
        "control": mission.control,
        "include_covariance": str(policy.include_covariance),
        "observation": policy.observation,
    }
    helper.set_model_props(model, props)
    onnx.checker.check_model(model)
    return model


def _network(builder: Builder, network: Network, x: str) -> str:
    """Name of the network's output, cut to [-1, 1]."""
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        layer = builder.constant(weight.astype(np.float64)), builder.constant(bias.astype(np.float64))
        x = builder.add("Gemm", x, *layer, transB=1)
        if i < len(network.weights) - 1:
            x = builder.add(_OPERATORS[network.activation], x)
    if network.squashed:
        x = builder.add("Tanh", x)
    return builder.add("Clip", x, builder.constant(np.float64(-1.0)), builder.constant(np.float64(1.0)))


def _columns(builder: Builder, table: str, count: int) -> list[Row]:
    """Columns of a table (N, count or more), in double precision."""
    table = builder.add("Cast", table, to=TensorProto.DOUBLE)
    return [Row(builder, builder.add("Gather", table, builder.constant(np.int64(k)), axis=1)) for k in range(count)]


def _rate_loop(
    builder: Builder, batch: Row, seen: list[Row], rates: list[Row], margin: float, mission: Mission
) -> list[Row]:
    """Fractions of the motors' limits for body rates that are commanded."""
    constants, n = PlantConstants.of([mission]), mission.satellite.wheels.count
    actions = np.full((1, n), None, dtype=object)
    decoded, commands = _decoded(seen, mission.layout, constants), np.array([rates], dtype=object)
    period = mission.scenario.decision_period
    Interpreter(builder, batch, drive_many)(decoded, commands, constants, margin, period, actions)
    return list(actions[0])


def _decoded(seen: list[Row], layout: dict[str, slice], own: PlantConstants) -> Belief:
    """As `Belief.read`, arrays of one episode whose numbers are rows."""
    part = {name: np.array(seen[place], dtype=object) for name, place in layout.items()}
    omega, spin = part["rate"] * own.rate_limit[0, 0], part["wheel_speed"] * own.max_spin[0]
    prior, change = own.prior[0], part["inertia"]
    inertia = np.zeros((3, 3), dtype=object)
    for i in range(3):
        inertia[i, i] = prior[i, i] * (1.0 + change[i])
    for k, (i, j) in enumerate(PRODUCTS[: len(change) - 3]):
        scale = float(np.sqrt(prior[i, i] * prior[j, j]))
        inertia[i, j] = inertia[j, i] = prior[i, j] + scale * change[3 + k]
    momentum = inertia @ omega + own.axes[0] @ spin
    torque = part["disturbance"] * own.disturbance_std[0, 0]
    arrays = (omega, spin, inertia, observed_std(part["uncertainty"]), momentum, torque)
    return Belief(*(array[None] for array in arrays))


def posed(policy: LearnedPolicy, satellite: str, scenario: str = "default", control: str = "torque") -> Problem:
    """What the policy flies on.

    Raises:
        ValueError: a name is unknown or does not fit the policy.
    """
    return problem(satellite, "random", scenario, control=control, **observation_settings(policy))  # type: ignore[arg-type]


def recorded(policy: LearnedPolicy, flown: Problem, decisions: int = 300) -> np.ndarray:
    """Observations (N, size) of an episode that the policy flies."""
    fleet = Fleet(flown, 1)
    fleet.rows.plants["stream"][0] = seed_stream(np.random.default_rng(0))
    fleet.begin()
    policy.reset(missions(flown)[0], [0])
    rows = []
    for _ in range(min(decisions, flown.scenario.decisions)):
        rows.append(fleet.rows.observations[0].copy())
        fleet.step(np.asarray(policy(rows[-1][None]), np.float32))
    return np.array(rows)


def session_of(model: onnx.ModelProto) -> onnxruntime.InferenceSession:
    """Session on one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])


def largest_difference(session: onnxruntime.InferenceSession, policy: LearnedPolicy, observations: np.ndarray) -> float:
    """Largest difference between the graph's actions and the policy's own, prepared as it is."""
    (exported,) = session.run(None, {"observation": observations})
    return float(np.abs(exported - policy(observations)).max())


def latency(session: onnxruntime.InferenceSession, observations: np.ndarray) -> float:
    """Median seconds of one decision, one observation a call."""
    times = []
    for row in observations:
        start = time.perf_counter()
        session.run(None, {"observation": row[None]})
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def export(policy: LearnedPolicy, output: Path, flown: Problem) -> tuple[float, float]:
    """Write the ONNX file; the largest difference to the policy's own actions, and the latency in seconds.

    Raises:
        ValueError: the graph's actions differ by more than 1e-6; nothing is written.
    """
    observations = recorded(policy, flown)
    model = graph(policy, missions(flown)[0])
    session = session_of(model)
    difference = largest_difference(session, policy, observations)
    if not difference <= TOLERANCE:
        raise ValueError(f"the exported graph differs from the policy by {difference:.1e}, more than {TOLERANCE:.0e}")
    write_bytes(output, model.SerializeToString())
    return difference, latency(session, observations)


@dataclass(frozen=True, kw_only=True)
class OnnxExport:
    """What to export and where to."""

    policy: tyro.conf.Positional[str]
    """A shipped policy's name, or a path without ending."""
    output: tyro.conf.Positional[Path]
    """The ONNX file to write."""
    satellite: str = "microsat"
    """Name or file of the data sheet that the rate loop is for."""
    scenario: str = "default"
    """Name or file of the world."""
    control: Literal["torque", "rate"] = "torque"
    """What an action is."""


def main(asked: OnnxExport) -> int:
    """Export, and print how close and how fast it is; the exit code."""
    with cli.user_errors():
        policy = find(asked.policy)
        flown = posed(policy, asked.satellite, asked.scenario, asked.control)
        difference, seconds = export(policy, asked.output, flown)
    print(f"{asked.output}: differs from the policy by at most {difference:.1e}; {1e6 * seconds:.1f} us a decision")
    return 0
