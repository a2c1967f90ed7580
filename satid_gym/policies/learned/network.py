"""Small networks of learned policies, in NumPy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from satid_gym.config import check_flag, unknown_name

_ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}


class NetworkMemory(NamedTuple):
    """What a policy of a network remembers of N episodes.

    Attributes:
        decisions: since the start.
        command: (N, out) in force.
        modes: (N, modes, 2) of `ModeLimit.state`; (0, 0, 2) where modes are not spared, and before the first decision.
    """

    decisions: int
    command: np.ndarray
    modes: np.ndarray

    def take(self, rows: np.ndarray) -> NetworkMemory:
        """Memory of the episodes of these numbers."""
        return NetworkMemory(self.decisions, self.command[rows], self.modes[rows] if len(self.modes) else self.modes)


@dataclass(frozen=True, eq=False)
class Network:
    """Multilayer perceptron.

    Attributes:
        weights: (out, in) of each layer.
        biases: (out,) of each layer.
        activation: between the layers, "tanh" or "relu".
        squashed: whether tanh follows the last layer.

    Raises:
        ValueError: there is no layer, one is not finite or its shape does not fit the one before, the activation is
            unknown, or `squashed` is not a bool.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str = "tanh"
    squashed: bool = False

    def __post_init__(self) -> None:
        if self.activation not in _ACTIVATIONS:
            raise unknown_name("activation of a network", self.activation, _ACTIVATIONS)
        check_flag("squashed of a network", self.squashed)
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError(
                f"a network has at least one layer, and as many weights as biases, got {len(self.weights)} and "
                f"{len(self.biases)}"
            )
        shapes = [(np.shape(weight), np.shape(bias)) for weight, bias in zip(self.weights, self.biases, strict=True)]
        for i, (weight, bias) in enumerate(shapes):
            fits = len(weight) == 2 and 0 not in weight and bias == weight[:1]
            if not fits or (i > 0 and weight[1:] != shapes[i - 1][1]):
                raise ValueError(f"layer {i} of the network does not fit: weight {weight}, bias {bias}")
            if not (np.isfinite(self.weights[i]).all() and np.isfinite(self.biases[i]).all()):
                raise ValueError(f"layer {i} of the network holds values that are not finite")

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Output (N, out) for observations (N, in), in double precision, for the same result on every machine."""
        x = np.asarray(observation, dtype=np.float64)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = _ACTIVATIONS[self.activation](x @ weight.T + bias)
        output = x @ self.weights[-1].T + self.biases[-1]
        return np.tanh(output) if self.squashed else output

    @classmethod
    def of_layers(cls, layers: Iterable[Any], activation: str = "tanh", squashed: bool = False) -> Network:
        """Network of the linear ones of torch's layers, in order; the other arguments are attributes."""
        linear = [layer for layer in layers if hasattr(layer, "in_features")]
        weights = tuple(layer.weight.detach().cpu().numpy().copy() for layer in linear)
        biases = tuple(layer.bias.detach().cpu().numpy().copy() for layer in linear)
        return cls(weights, biases, activation, squashed)

    def tensors(self) -> dict[str, np.ndarray]:
        """Tensors of the layers by name."""
        named = {f"weight.{i}": w for i, w in enumerate(self.weights)}
        return named | {f"bias.{i}": b for i, b in enumerate(self.biases)}

    @classmethod
    def from_tensors(
        cls, tensors: Mapping[str, np.ndarray], activation: str = "tanh", squashed: bool = False
    ) -> Network:
        """Network from the tensors that `tensors` gives; the other arguments are attributes.

        Raises:
            ValueError: a layer is missing or not of float32, or the network is refused.
        """
        count = len(tensors) // 2
        names = {f"{kind}.{i}" for kind in ("weight", "bias") for i in range(count)}
        if count == 0 or set(tensors) != names:
            raise ValueError(f"the network's tensors must be weight.i and bias.i, got {sorted(tensors)}")
        for name, tensor in tensors.items():
            if tensor.dtype != np.float32:
                raise ValueError(f"{name} of the network must be float32, got {tensor.dtype}")
        weights = tuple(np.asarray(tensors[f"weight.{i}"], np.float32) for i in range(count))
        biases = tuple(np.asarray(tensors[f"bias.{i}"], np.float32) for i in range(count))
        return cls(weights, biases, activation, squashed)
