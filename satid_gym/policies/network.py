"""Small networks of learned policies, in NumPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from satid_gym.config import check_flag, unknown_name

_ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}


@dataclass(frozen=True, eq=False)
class Network:
    """Multilayer perceptron.

    Attributes:
        weights: (out, in) of each layer.
        biases: (out,) of each layer.
        activation: between the layers, "tanh" or "relu".
        squashed: whether tanh follows the last layer.

    Raises:
        ValueError: the activation is unknown, or `squashed` is not a bool.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str = "tanh"
    squashed: bool = False

    def __post_init__(self) -> None:
        if self.activation not in _ACTIVATIONS:
            raise unknown_name("activation of a network", self.activation, _ACTIVATIONS)
        check_flag("squashed of a network", self.squashed)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Output (N, out) for observations (N, in), in double precision, for the same result on every machine."""
        x = np.asarray(observation, dtype=np.float64)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = _ACTIVATIONS[self.activation](x @ weight.T + bias)
        output = x @ self.weights[-1].T + self.biases[-1]
        return np.tanh(output) if self.squashed else output

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
            ValueError: a layer is missing, not finite, or its shape does not fit the one before.
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
        for i, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            fits = weight.ndim == 2 and weight.size > 0 and bias.shape == weight.shape[:1]
            if not fits or (i > 0 and weight.shape[1] != weights[i - 1].shape[0]):
                raise ValueError(f"layer {i} of the network does not fit: weight {weight.shape}, bias {bias.shape}")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError(f"layer {i} of the network holds values that are not finite")
        return cls(weights, biases, activation, squashed)
