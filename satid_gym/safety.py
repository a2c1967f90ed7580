"""Costs separate from the reward, as in Safety-Gymnasium: `step` returns them between reward and terminated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper

from satid_gym.config import check_number, unknown_name
from satid_gym.gym_api import COSTS


def _check_limits(limits: Mapping[str, float] | None) -> dict[str, float]:
    """Limits of costs by name, in the order given; empty where None.

    Raises:
        ValueError: there are no limits in the mapping, a name is unknown, or a limit is not from 0 to 1.
    """
    if limits is None:
        return {}
    if not isinstance(limits, Mapping) or not limits:
        raise ValueError(f'limits must be a mapping like {{"rate": 0.01}} of costs {COSTS}, or None, got {limits!r}')
    for name in limits:
        if name not in COSTS:
            raise unknown_name("cost", name, COSTS)
    return {name: check_number(f"limit of cost {name!r}", limit, high=1.0) for name, limit in limits.items()}


def _chosen(info: Mapping[str, Any], limits: Mapping[str, float]) -> Any:
    """The costs of an info that have limits, (..., k); the largest of all where none has.

    Raises:
        ValueError: there are no costs in the info.
    """
    if "cost" not in info or "costs" not in info:
        raise ValueError(
            f"the environment's info has no costs, only {sorted(info)}: expected SatInertiaIDEnv or "
            "SatInertiaIDVectorEnv, also in wrappers that leave infos as they are"
        )
    if not limits:
        return info["cost"]
    return np.stack([np.asarray(info["costs"][name], dtype=float) for name in limits], axis=-1)


class SafetyEnv(gymnasium.Wrapper):
    """`SatInertiaIDEnv` with the interface of Safety-Gymnasium.

    It is the outermost wrapper, because Gymnasium's own take steps of five values.

    Args:
        env: the environment, also in wrappers of Gymnasium.
        limits: limit of each cost that is constrained, by its name in `info["costs"]`: the share from 0 to 1 that its
            mean over an episode's decisions may be. None: the cost is the one number `info["cost"]`, the largest.

    Attributes:
        limits: the same, in the order of the cost's numbers; empty where None.

    Raises:
        ValueError: a cost is unknown, or a limit is not from 0 to 1.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], limits: Mapping[str, float] | None = None) -> None:
        super().__init__(env)
        self.limits = _check_limits(limits)

    def step(self, action: Any) -> tuple[np.ndarray, float, Any, bool, bool, dict[str, Any]]:  # type: ignore[override]
        """Take one decision.

        Returns:
            Observation, reward, cost (a number, or an array (k,) of those with limits), terminated, truncated, info.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward), _chosen(info, self.limits), terminated, truncated, info


class SafetyVectorEnv(VectorWrapper):
    """`SatInertiaIDVectorEnv` with the interface of Safety-Gymnasium, in every mode of autoreset.

    Costs are those of the decision that the rewards are of: with SAME_STEP an episode's last costs, which the infos
    hold in `final_info`, are returned with its end, as Safety-Gymnasium does, and not the next episode's; with
    NEXT_STEP the step that resets, which takes no decision, costs nothing. Safety-Gymnasium's name for the last
    observation, `final_observation`, is in the infos as well.

    Args:
        env: the environments, native or Gymnasium's.
        limits: as of `SafetyEnv`.

    Attributes:
        limits: as of `SafetyEnv`.

    Raises:
        ValueError: a cost is unknown, or a limit is not from 0 to 1.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], limits: Mapping[str, float] | None = None) -> None:
        super().__init__(env)
        self.limits = _check_limits(limits)

    def step(  # type: ignore[override]
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take one decision in every environment.

        Returns:
            Observations, rewards, costs ((num_envs,), or (num_envs, k) of those with limits), terminations,
            truncations, infos.
        """
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        costs = np.array(_chosen(infos, self.limits), dtype=float)
        if "final_info" in infos:
            ended = infos["_final_info"]
            costs[ended] = np.asarray(_chosen(infos["final_info"], self.limits))[ended]
            infos |= {"final_observation": infos["final_obs"], "_final_observation": infos["_final_obs"]}
        return observations, rewards, costs, terminations, truncations, infos
