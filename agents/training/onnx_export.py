"""Export a policy's network to ONNX: `python -m agents.export POLICY OUTPUT.onnx`.

The graph takes observations (N, size), float32, with the filter's whole covariance where the model's property
include_covariance is True, and gives commands (N, 3) in [-1, 1]: body rates as fractions of what the envelope allows
where the policy's control is "rate" (satid_gym/control/rate_loop.py turns them into torque), motor torque where it is
"torque". It is checked against the same layers in torch before it is kept.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
import tyro
from onnx import TensorProto, helper, numpy_helper

from baselines.command import cli
from satid_gym.core.observation import BOUND
from satid_gym.files import write_bytes
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.shipped import find

TOLERANCE = 1e-6
_OPSET = 17
_OPERATORS = {"tanh": "Tanh", "relu": "Relu"}


def graph(policy: LearnedPolicy) -> onnx.ModelProto:
    """The network as an ONNX model."""
    network = policy.network
    size, outputs = network.weights[0].shape[1], network.weights[-1].shape[0]
    nodes, constants, x = [helper.make_node("Cast", ["observation"], ["input"], to=TensorProto.DOUBLE)], [], "input"
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        constants.append(numpy_helper.from_array(weight.astype(np.float64), f"weight.{i}"))
        constants.append(numpy_helper.from_array(bias.astype(np.float64), f"bias.{i}"))
        last = i == len(network.weights) - 1
        y = "output" if last else f"layer.{i}"
        nodes.append(helper.make_node("Gemm", [x, f"weight.{i}", f"bias.{i}"], [y], transB=1))
        if not last:
            nodes.append(helper.make_node(_OPERATORS[network.activation], [y], [f"{y}.active"]))
        x = f"{y}.active"
    if network.squashed:
        nodes.append(helper.make_node("Tanh", ["output"], ["squashed"]))
    constants.append(numpy_helper.from_array(np.array(-1.0), "least"))
    constants.append(numpy_helper.from_array(np.array(1.0), "most"))
    nodes.append(helper.make_node("Clip", ["squashed" if network.squashed else "output", "least", "most"], ["clipped"]))
    nodes.append(helper.make_node("Cast", ["clipped"], ["command"], to=TensorProto.FLOAT))
    entry = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", size])
    exit_ = helper.make_tensor_value_info("command", TensorProto.FLOAT, ["batch", outputs])
    model = helper.make_model(
        helper.make_graph(nodes, policy.name, [entry], [exit_], constants),
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=8,
    )
    props = {
        "control": policy.control,
        "margin": str(policy.margin),
        "include_covariance": str(policy.include_covariance),
        "observation": policy.observation,
    }
    helper.set_model_props(model, props)
    onnx.checker.check_model(model)
    return model


def torch_network(network: Network) -> torch.nn.Sequential:
    """The same layers in torch, in double precision, and the cut to [-1, 1]."""
    layers: list[torch.nn.Module] = []
    for weight, bias in zip(network.weights, network.biases, strict=True):
        layer = torch.nn.Linear(weight.shape[1], weight.shape[0])
        layer.weight.data, layer.bias.data = torch.from_numpy(weight), torch.from_numpy(bias)
        layers += [layer.double(), torch.nn.Tanh() if network.activation == "tanh" else torch.nn.ReLU()]
    last = [torch.nn.Tanh()] if network.squashed else []
    return torch.nn.Sequential(*layers[:-1], *last, torch.nn.Hardtanh())


def largest_difference(session: onnxruntime.InferenceSession, network: Network, rows: int = 10_000) -> float:
    """Largest difference between ONNX and torch over random observations."""
    rng = np.random.default_rng(0)
    observations = np.clip(rng.standard_normal((rows, network.weights[0].shape[1])), -BOUND, BOUND).astype(np.float32)
    (exported,) = session.run(None, {"observation": observations})
    with torch.no_grad():
        trained = torch_network(network)(torch.from_numpy(observations).double()).numpy()
    return float(np.abs(exported - trained).max())


def latency(session: onnxruntime.InferenceSession, size: int, calls: int = 5000) -> float:
    """Median seconds of one decision, one observation a call."""
    observation = {"observation": np.zeros((1, size), np.float32)}
    times = []
    for _ in range(calls):
        start = time.perf_counter()
        session.run(None, observation)
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def export(policy: LearnedPolicy, output: Path) -> tuple[float, float]:
    """Write the ONNX file; the largest difference to torch and the latency in seconds.

    Raises:
        ValueError: the exported network differs from torch by more than 1e-6; nothing is written.
    """
    model = graph(policy).SerializeToString()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    difference = largest_difference(session, policy.network)
    if difference > TOLERANCE:
        raise ValueError(f"the exported network differs from torch by {difference:.1e}, more than {TOLERANCE:.0e}")
    write_bytes(output, model)
    return difference, latency(session, policy.network.weights[0].shape[1])


@dataclass(frozen=True, kw_only=True)
class OnnxExport:
    """What to export and where to."""

    policy: tyro.conf.Positional[str]
    """A shipped policy's name, or a path without ending."""
    output: tyro.conf.Positional[Path]
    """The ONNX file to write."""


def main(asked: OnnxExport) -> int:
    """Export, and print how close and how fast it is; the exit code."""
    with cli.user_errors():
        difference, seconds = export(find(asked.policy), asked.output)
    print(f"{asked.output}: differs from torch by at most {difference:.1e}; {1e6 * seconds:.1f} us a decision")
    return 0
