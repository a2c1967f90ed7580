"""Vector environments for Stable-Baselines3, on the native vector environment.

The only module of the library that imports Stable-Baselines3; no other module imports this one.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv

from satid_gym.config import real_array
from satid_gym.control.mode_limit import ModeLimit
from satid_gym.control.rate_loop import rate_loop
from satid_gym.gym_api import COSTS
from satid_gym.policy import missions
from satid_gym.vector import SatInertiaIDVectorEnv


class SatInertiaIDVecEnv(VecEnv):
    """`SatInertiaIDVectorEnv` as a Stable-Baselines3 `VecEnv`.

    The info of an episode's last step holds `terminal_observation`, `TimeLimit.truncated`, `episode`
    (as Stable-Baselines3's Monitor gives it), the final `relative_error`, and `costs`: by name, the mean of each cost
    over the episode's decisions. Other infos are empty, because no algorithm reads them and making them takes longer
    than a step.

    Args:
        num_envs: number of environments.
        bootstrap: True reports the horizon as a time limit, so that algorithms add the value of the last state
            (one forward pass for every episode). False reports it as the end of the task, which is right for a policy
            that observes the time left.
        stagger: start the first episodes with less time left, evenly spread, so that a rollout holds every part
            of an episode and resets are spread over time. For training only: the first episodes are shorter,
            which would distort an evaluation.
        **settings: of `SatInertiaIDVectorEnv`, without `autoreset_mode`.
    """

    def __init__(self, num_envs: int, *, bootstrap: bool = False, stagger: bool = False, **settings: Any) -> None:
        self.vector_env = SatInertiaIDVectorEnv(
            num_envs, autoreset_mode=AutoresetMode.SAME_STEP, stagger=stagger, **settings
        )
        self.bootstrap = bootstrap
        self._actions: np.ndarray | None = None
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, np.int64)
        self._costs = np.zeros((num_envs, len(COSTS)))  # sums over the episode so far, as the returns
        self._last_costs = self._costs.copy()
        self._start = time.monotonic()
        super().__init__(num_envs, self.vector_env.single_observation_space, self.vector_env.single_action_space)

    def reset(self) -> np.ndarray:
        """Start an episode in every environment, with the seeds and options that were set, if any."""
        seeds = self._seeds if any(s is not None for s in self._seeds) else None
        options = self._options[0]
        if any(o != options for o in self._options):
            raise ValueError("reset options must be the same for all environments")
        observations, _ = self.vector_env.reset(seed=seeds, options=options)
        self._reset_seeds()
        self._reset_options()
        self._begin_sums(slice(None))
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = np.asarray(actions)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take one decision in every environment; ended episodes are restarted."""
        if self._actions is None:
            raise RuntimeError("call step_async(actions) before step_wait()")
        observations, rewards, terminated, truncated, vector_infos = self.vector_env.step(self._actions)
        self._actions = None
        self._returns += rewards
        self._lengths += 1
        dones = terminated | truncated
        fleet = self.vector_env.fleet  # whose reports are those of new episodes where old ones are done
        self._last_costs = np.where(dones[:, None], fleet.final.reports["costs"], fleet.rows.reports["costs"])
        self._costs += self._last_costs
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(dones):
            infos[i] = {
                "terminal_observation": vector_infos["final_obs"][i],
                "TimeLimit.truncated": bool(self.bootstrap and truncated[i]),
                "relative_error": float(vector_infos["final_info"]["relative_error"][i]),
                "episode": {
                    "r": float(self._returns[i]),
                    "l": int(self._lengths[i]),
                    "t": round(time.monotonic() - self._start, 6),
                },
                "costs": dict(zip(COSTS, (self._costs[i] / self._lengths[i]).tolist(), strict=True)),
            }
        self._begin_sums(dones)
        return observations, rewards.astype(np.float32), dones, infos

    @property
    def costs(self) -> dict[str, np.ndarray]:
        """Costs (N,) of the last decision by name, which a wrapper may take off the rewards."""
        return dict(zip(COSTS, self._last_costs.T, strict=True))

    def _begin_sums(self, rows: slice | np.ndarray) -> None:
        """Begin the sums of new episodes in some rows, (N,) bool or a slice."""
        self._returns[rows], self._lengths[rows], self._costs[rows] = 0.0, 0, 0.0

    def close(self) -> None:
        """End the threads."""
        self.vector_env.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """The attribute of the vector environment, once for each index; of spaces, one environment's.

        Spaces are those that an algorithm sees; `problem` is that of `vector_env`, below any rate loop of this adapter.
        """
        owner = self if attr_name in ("action_space", "observation_space") else self.vector_env
        return [getattr(owner, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Unsupported: the environments of a compiled vector share their attributes and methods."""
        raise NotImplementedError(
            "environments of a compiled vector have no attributes of their own; make a new vector"
        )

    def env_method(
        self, method_name: str, *args: Any, indices: int | Iterable[int] | None = None, **kwargs: Any
    ) -> list[Any]:
        """Unsupported: the environments of a compiled vector share their attributes and methods."""
        raise NotImplementedError("compiled environments have no methods of their own; call vector_env's")

    def env_is_wrapped(self, wrapper_class: type, indices: int | Iterable[int] | None = None) -> list[bool]:
        """True for Monitor, False for any other wrapper.

        Stable-Baselines3 asks for Monitor to find out whether the infos hold `episode`, the return and length of
        each whole episode, as they do here.
        """
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]

    def state(self) -> dict[str, np.ndarray]:
        """State from which `restore` continues exactly."""
        sums = {"returns": self._returns, "lengths": self._lengths, "costs": self._costs}
        return {**self.vector_env.state(), **{name: values.copy() for name, values in sums.items()}}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Return to a `state` of an adapter with the same settings."""
        self.vector_env.restore(state)
        self._returns, self._lengths, self._costs = (state[name].copy() for name in ("returns", "lengths", "costs"))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds for the next reset: seed + i for environment i."""
        self._seeds = [None if seed is None else seed + i for i in range(self.num_envs)]
        return self._seeds


class RateCommandVecEnv(SatInertiaIDVecEnv):
    """`SatInertiaIDVecEnv` whose actions are body rates over their limits; the rate loop gives the torque.

    Args:
        num_envs: number of environments.
        margin: of the rate loop, see `satid_gym.control.rate_loop`; None means that actions are the environment's own.
        spares_modes: whether commands are changed so that panels and tanks stay inside their limit, see
            `satid_gym.control.mode_limit`.
        **settings: of `SatInertiaIDVecEnv`.

    Attributes:
        seconds: time spent in the environments and the rate loop so far.
        margin, spares_modes: as given.
    """

    def __init__(
        self, num_envs: int, *, margin: float | None = 2.6, spares_modes: bool = False, **settings: Any
    ) -> None:
        super().__init__(num_envs, **settings)
        self.margin, self.spares_modes, self.seconds = margin, spares_modes, 0.0
        flown = missions(self.vector_env.problem)
        self._loop = None if margin is None else (ModeLimit if spares_modes else rate_loop)(flown, margin)
        self._observations = np.empty((num_envs, 0), np.float32)  # until reset
        self._rows = np.full(num_envs, -1)
        if self._loop is not None:
            self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)

    def reset(self) -> np.ndarray:
        """Start an episode in every environment."""
        self._observations = super().reset()
        return self._observations

    def step_async(self, actions: np.ndarray) -> None:
        """Convert rate commands to the environment's actions and keep these for `step_wait`."""
        start = time.perf_counter()
        if self._loop is not None:
            if self._observations.shape[1] == 0:
                raise gymnasium.error.ResetNeeded("call reset() before step()")
            actions = real_array("actions", actions, (self.num_envs, 3))
            rows = self.vector_env.satellite_index
            if not np.array_equal(rows, self._rows):
                self._loop.assign(rows)
                self._rows = rows
            actions = self._loop(self._observations, actions)
        super().step_async(actions)
        self.seconds += time.perf_counter() - start

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take one decision in every environment."""
        start = time.perf_counter()
        result = super().step_wait()
        self._observations = result[0]
        self.seconds += time.perf_counter() - start
        return result

    def state(self) -> dict[str, np.ndarray]:
        """State from which `restore` continues exactly."""
        return super().state() | ({"sheets": self._loop.state()} if isinstance(self._loop, ModeLimit) else {})

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Return to a `state`."""
        super().restore(state)
        if isinstance(self._loop, ModeLimit):
            self._loop.restore(state["sheets"])
        self._observations = state["observations"].copy()
        self._rows = np.full(self.num_envs, -1)
