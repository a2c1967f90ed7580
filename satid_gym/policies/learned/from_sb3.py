"""Policies of models that Stable-Baselines3 has trained, for commands, tables and flights.

It reads a model's layers and its environment's settings, and imports neither torch nor Stable-Baselines3.
"""

from __future__ import annotations

from typing import Any

from satid_gym.policies.learned.network import Network
from satid_gym.policies.learned.policy import LearnedPolicy

_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu"}


def learned_policy(model: Any, name: str = "mine") -> LearnedPolicy:
    """The deterministic action of a model as a policy, which flies as the model was trained.

    Args:
        model: PPO, A2C or SAC with an "MlpPolicy", whose environment is a `SatInertiaIDVecEnv` or `RateCommandVecEnv`
            of `satid_gym.sb3`; after `load`, give `load` the environment.
        name: of the policy in tables; letters, digits and ._- only.

    Raises:
        ValueError: the model is of another algorithm, network or environment, or observations are changed on the way.
    """
    env = _environment(model)
    problem, margin = env.vector_env.problem, getattr(env, "margin", None)
    return LearnedPolicy(
        name,
        _network(model),
        "rate" if margin is not None else problem.control,
        margin or 0.0,
        problem.include_covariance,
        {"trained_by": type(model).__name__, "timesteps": int(model.num_timesteps)},
        observation=problem.observation,
        include_walk=problem.include_walk,
        spares_modes=getattr(env, "spares_modes", False),
    )


def _environment(model: Any) -> Any:
    """The adapter below wrappers that leave observations alone."""
    env = outer = model.get_env()
    while hasattr(env, "venv"):
        if hasattr(env, "obs_rms") or env.observation_space != env.venv.observation_space:
            raise ValueError(
                f"{type(env).__name__} changes the observations, and a policy gets them as the environment gives them, "
                "scaled already: train without it"
            )
        env = env.venv
    if not hasattr(env, "vector_env"):
        raise ValueError(
            f"the environment of the model is {'missing' if outer is None else type(env).__name__}: give it one of "
            "satid_gym.sb3, such as RateCommandVecEnv (after load by load(path, env=env))"
        )
    return env


def _network(model: Any) -> Network:
    policy = model.policy
    if policy.features_extractor_class.__name__ != "FlattenExtractor":
        raise ValueError('a model with a features extractor cannot be used: train with "MlpPolicy" as it is')
    if hasattr(policy, "lstm_actor"):
        raise ValueError("a recurrent model cannot be used: train PPO, A2C or SAC")
    if hasattr(policy, "mlp_extractor") and hasattr(policy, "action_net"):
        layers, squashed = [*policy.mlp_extractor.policy_net, policy.action_net], bool(policy.squash_output)
    elif hasattr(getattr(policy, "actor", None), "latent_pi"):
        layers, squashed = [*policy.actor.latent_pi, policy.actor.mu], True
    else:
        raise ValueError(f"a model of {type(model).__name__} cannot be used: train PPO, A2C or SAC")
    used = {type(layer).__name__ for layer in layers} - {"Linear"}
    if not used <= set(_ACTIVATIONS) or len(used) > 1:
        raise ValueError(
            f"a model with activations {', '.join(sorted(used))} cannot be used: choose one of "
            f"{', '.join(_ACTIVATIONS)} by policy_kwargs"
        )
    return Network.of_layers(layers, _ACTIVATIONS[used.pop()] if used else "tanh", squashed)
