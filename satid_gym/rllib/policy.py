"""RLlib's modules as policies of this library, with the normalisation of their observations."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from ray.rllib.connectors.env_to_module import MeanStdFilter
from ray.rllib.core.rl_module import RLModule
from ray.rllib.utils.filter import RunningStat
from ray.rllib.utils.numpy import SMALL_NUMBER

from satid_gym.policies.learned import LearnedPolicy, Network

_STACKS = ("encoder.actor_encoder.", "encoder.encoder.", "pi.")  # of RLlib's default module, the second where shared


def learned_policy(
    name: str, module: RLModule, *, normalised: MeanStdFilter | None = None, control: str, **settings: Any
) -> LearnedPolicy:
    """The mean action of a module as a policy, to be saved, compared and flown without Ray.

    Args:
        name: what tables call it.
        module: RLlib's default module of PPO or another with its encoder and policy head, without recurrent layers.
        normalised: connector by which observations were normalised; what never varied in them counts for nothing.
        control: "rate" or "torque", what the module's actions are.
        **settings: of `LearnedPolicy`: margin of the rate loop (0 where not given), `include_covariance`,
            `observation` and `details`.

    Raises:
        ValueError: a layer is not a plain linear one with tanh or relu in between, or the connector cuts what it
            normalised.
    """
    state = {key: np.array(value, np.float32) for key, value in module.get_state().items()}
    layers = [(w, state[key[: -len("weight")] + "bias"]) for key, w in state.items() if _is_weight(key)]
    config = module.model_config
    config = dict(config) if isinstance(config, Mapping) else dataclasses.asdict(config)
    activation = config["fcnet_activation"]
    if config["head_fcnet_hiddens"] and config["head_fcnet_activation"] != activation:
        raise ValueError(
            f"a policy has one activation, got {activation!r} and {config['head_fcnet_activation']!r}: give the module "
            "the same head_fcnet_activation as fcnet_activation"
        )
    if not layers or any(weight.ndim != 2 for weight, _ in layers):
        raise ValueError(
            f"a policy has linear layers alone, got {', '.join(state)}: give the module fully connected layers "
            "without normalisation in between"
        )
    if not config["free_log_std"]:  # the other half of the outputs is the exploration's
        weight, bias = layers[-1]
        layers[-1] = weight[: len(weight) // 2], bias[: len(bias) // 2]
    if normalised is not None:
        layers[0] = _folded(*layers[0], normalised)
    network = Network(tuple(w for w, _ in layers), tuple(b for _, b in layers), activation)
    return LearnedPolicy(name, network, control, settings.pop("margin", 0.0), **settings)


def _is_weight(key: str) -> bool:
    return key.startswith(_STACKS) and key.endswith(".weight")


def _folded(weight: np.ndarray, bias: np.ndarray, normalised: MeanStdFilter) -> tuple[np.ndarray, np.ndarray]:
    """The first layer for observations as they are: W (x - mean) / std + b = W' x + b'."""
    state = normalised.get_state()[None]
    if np.isfinite(state["clip_by_value"]):
        raise ValueError(
            f"a policy's layers are linear, got observations cut at {state['clip_by_value']} standard deviations: "
            'train with MeanStdFilter(clip_by_value=float("inf"))'
        )
    (stat,) = (RunningStat.from_state(values) for values in state["running_stats"])
    mean = stat.mean if state["de_mean_to_zero"] else np.zeros(weight.shape[1])
    std = stat.std + SMALL_NUMBER if state["de_std_to_one"] else np.ones(weight.shape[1])
    scaled = np.where(std > 2.0 * SMALL_NUMBER, weight / std, 0.0)
    return scaled.astype(np.float32), (bias - scaled @ mean).astype(np.float32)
