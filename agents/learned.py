"""Learned policies: a small network in numpy, read from safetensors and JSON; loading one executes no code."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file, save_file

from baselines.rate_loop import RateLoop
from satid_gym.config import unknown_name
from satid_gym.policy import Kind, Mission

FORMAT = 1
CONTROLS = ("rate", "torque")


@dataclass(frozen=True, eq=False)
class Network:
    """A multilayer perceptron with tanh between its layers.

    Attributes:
        weights: (out, in) of each layer.
        biases: (out,) of each layer.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Output (N, out) for observations (N, in), in double precision: the same on every machine."""
        x = np.asarray(observation, dtype=np.float64)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.tanh(x @ weight.T + bias)
        return x @ self.weights[-1].T + self.biases[-1]

    def tensors(self) -> dict[str, np.ndarray]:
        """The layers by name."""
        named = {f"weight.{i}": w for i, w in enumerate(self.weights)}
        return named | {f"bias.{i}": b for i, b in enumerate(self.biases)}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, np.ndarray]) -> Network:
        """The inverse of `tensors`.

        Raises:
            ValueError: a layer is missing, not finite, or its shape does not fit the one before.
        """
        count = len(tensors) // 2
        names = {f"{kind}.{i}" for kind in ("weight", "bias") for i in range(count)}
        if count == 0 or set(tensors) != names:
            raise ValueError(f"the network's tensors must be weight.i and bias.i, got {sorted(tensors)}")
        weights = tuple(np.asarray(tensors[f"weight.{i}"], np.float32) for i in range(count))
        biases = tuple(np.asarray(tensors[f"bias.{i}"], np.float32) for i in range(count))
        for i, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            fits = weight.ndim == 2 and bias.shape == weight.shape[:1]
            if not fits or (i > 0 and weight.shape[1] != weights[i - 1].shape[0]):
                raise ValueError(f"layer {i} of the network does not fit: weight {weight.shape}, bias {bias.shape}")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError(f"layer {i} of the network holds values that are not finite")
        return cls(weights, biases)


class LearnedPolicy:
    """A network that commands body rates (through the rate loop) or wheel torque (at once).

    Args:
        name: what tables call it.
        network: from observation to command.
        control: "rate" or "torque".
        margin: of the rate loop; see `RateLoop`.
        details: how it was trained and what it scored; kept in the JSON file.

    Raises:
        ValueError: the control is unknown.
    """

    kind: Kind = "learned"

    def __init__(
        self, name: str, network: Network, control: str, margin: float, details: Mapping[str, Any] | None = None
    ) -> None:
        if control not in CONTROLS:
            raise unknown_name("control of a learned policy", control, CONTROLS)
        self.name, self.network, self.control, self.margin = name, network, control, margin
        self.details = dict(details or {})

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Take in the satellite.

        Raises:
            ValueError: the network was trained for another observation.
        """
        size, expected = max(p.stop for p in mission.layout.values()), self.network.weights[0].shape[1]
        if size != expected:
            raise ValueError(
                f"policy {self.name} takes observations of {expected} numbers, this environment gives {size}: "
                "it must have as many wheels and inertia parameters as the one it was trained on"
            )
        self._loop = RateLoop([mission], self.margin)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        command = self.network(observation)
        if self.control == "torque":
            return np.clip(command, -1.0, 1.0)
        return self._loop(observation, command)

    def save(self, path: Path) -> None:
        """Write `path`.safetensors and `path`.json, each whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        head = {"format": FORMAT, "name": self.name, "control": self.control, "margin": self.margin}
        tensors, text = _beside(path, ".safetensors"), _beside(path, ".json")
        temporary = tensors.with_name(tensors.name + ".part")
        save_file({k: np.ascontiguousarray(v) for k, v in self.network.tensors().items()}, temporary)
        temporary.chmod(0o644)  # safetensors writes for the owner alone
        os.replace(temporary, tensors)
        temporary = text.with_name(text.name + ".part")
        temporary.write_text(json.dumps({**head, **self.details}, indent=2) + "\n")
        os.replace(temporary, text)

    @classmethod
    def load(cls, path: Path) -> LearnedPolicy:
        """Read what `save` wrote; `path` with or without an ending.

        Raises:
            FileNotFoundError: one of the two files is missing.
            ValueError: a file is damaged or of another format.
        """
        base = path.with_suffix("") if path.suffix in (".safetensors", ".json") else path
        tensors, text = _beside(base, ".safetensors"), _beside(base, ".json")
        for file in (tensors, text):
            if not file.is_file():
                raise FileNotFoundError(f"no policy at {base}: {file} is missing; a policy is a pair of files")
        try:
            head = json.loads(text.read_text())
        except ValueError as error:
            raise ValueError(f"{text} is not JSON: {error}; copy the policy again") from error
        if not isinstance(head, dict) or head.get("format") != FORMAT:
            raise ValueError(f"{text} is not a policy of format {FORMAT}; train it again with this version")
        try:
            network = Network.from_tensors(load_file(tensors))
        except Exception as error:
            raise ValueError(f"{tensors} holds no network: {error}; copy the policy again") from error
        details = {k: v for k, v in head.items() if k not in ("format", "name", "control", "margin")}
        return cls(str(head["name"]), network, str(head["control"]), float(head["margin"]), details)


def _beside(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)
