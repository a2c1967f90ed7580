"""Env runner for Ray's RLlib that steps a vector environment as a whole and builds episodes from arrays."""

from __future__ import annotations

import time
import uuid
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.connectors.module_to_env import GetActions
from ray.rllib.core.columns import Columns
from ray.rllib.env.env_runner import ENV_STEP_FAILURE
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from ray.rllib.utils.metrics import RLMODULE_INFERENCE_TIMER, WEIGHTS_SEQ_NO
from ray.rllib.utils.numpy import convert_to_numpy
from ray.rllib.utils.spaces.space_utils import clip_action, unsquash_action
from ray.rllib.utils.torch_utils import convert_to_torch_tensor

_EPISODE_CALLBACKS = ("on_episode_created", "on_episode_start", "on_episode_step", "on_episode_end")
_RESET = "reset"  # column of the steps that only reset an environment

Scores = tuple[int, float, float]
"""Length, return and seconds of an episode."""
Ended = tuple[SingleAgentEpisode, Scores]


class ArrayEnvRunner(SingleAgentEnvRunner):
    """RLlib's env runner for a vector environment, without its loop over environments in every step.

    To be used by `config.env_runners(env_runner_cls=ArrayEnvRunner, gym_env_vectorize_mode="vector_entry_point")`. From
    the same seed it gives the same episodes as RLlib's own runner, in the same order, so that an algorithm learns the
    same. Chunks of episodes have no lookback buffer, and their infos are empty but for the last one of an episode.

    Args:
        config: of the algorithm. Observations go to the module as they are, actions to the environment as RLlib's
            default connectors bring them there.
        **kwargs: of RLlib's runner.

    Raises:
        ValueError: the config has connectors of its own between environment and module, or callbacks for each episode
            or step; the module is stateful; or the environment's autoreset mode is not NEXT_STEP, which is RLlib's.
    """

    env: Any  # None in a process that only learns
    module: Any
    _needs_initial_reset: bool

    def __init__(self, *, config: AlgorithmConfig, **kwargs: Any) -> None:
        self._get_actions = GetActions()
        self._ended: list[Scores] = []  # since the last call of `get_metrics`
        super().__init__(config=config, **kwargs)
        for what in self._unsupported():
            raise ValueError(
                f"ArrayEnvRunner steps all environments at once, without {what}: leave these out of the config, or "
                "env_runner_cls, which gives RLlib's own runner"
            )

    def _unsupported(self) -> Iterator[str]:
        """Parts of the config that only RLlib's own runner supports."""
        config = self.config
        if config._env_to_module_connector or config._module_to_env_connector:
            yield "custom connectors between environment and module"
        for name in _EPISODE_CALLBACKS:
            own = any(getattr(type(made), name) is not getattr(RLlibCallback, name) for made in self._callbacks)
            if own or getattr(config, f"callbacks_{name}"):
                yield f"the callback {name} (on_sample_end gets the same episodes)"
        if self.module is not None and self.module.is_stateful():
            yield "the state of a recurrent module"
        if self.env is not None and self.env.metadata["autoreset_mode"] is not AutoresetMode.NEXT_STEP:
            yield f"autoreset mode {self.env.metadata['autoreset_mode']}, only with NEXT_STEP"

    def make_env(self) -> None:
        """Make the vector environment; its infos stay arrays."""
        super().make_env()
        self.env = self.env.env  # without the wrapper that makes a dict of infos for each environment

    def get_metrics(self) -> dict[str, Any]:
        """Metrics since the last call; of an episode that was cut into chunks those of the whole."""
        for episode in self._ended:
            self._log_episode_metrics(*episode)
        self._ended.clear()
        return self.metrics.reduce()

    def _reset_envs(self, episodes: list[Any], shared_data: dict[str, Any], explore: bool) -> None:
        """Start an episode in every environment."""
        self._observations, _ = self._try_env_reset(seed=self._seed if self._needs_initial_reset else None)
        count = self.num_envs
        self._over = np.zeros(count, bool)  # environments whose next step is but a reset
        self._ids, self._begun = [""] * count, np.zeros(count)
        self._lengths, self._returns = np.zeros(count, int), np.zeros(count)
        self._begin(np.arange(count))

    def _begin(self, rows: np.ndarray) -> None:
        """Note that new episodes begin in these environments."""
        self._lengths[rows], self._returns[rows], self._begun[rows] = 0, 0.0, time.perf_counter()
        for i in rows:
            self._ids[i] = uuid.uuid4().hex

    def _sample(
        self,
        *,
        num_timesteps: int | None = None,
        num_episodes: int | None = None,
        explore: bool,
        random_actions: bool = False,
        force_reset: bool = False,
    ) -> list[SingleAgentEpisode]:
        """Episodes and chunks of at least the given steps, or whole episodes from a reset; see `sample`."""
        if force_reset or num_episodes is not None or self._needs_initial_reset:
            self._reset_envs_and_episodes(explore)
        self._needs_initial_reset = num_episodes is not None
        steps, ended = 0, 0
        columns: dict[str, list[np.ndarray]] = defaultdict(list)
        columns[Columns.OBS].append(self._observations)
        infos: list[Mapping[str, Any]] = []
        while steps < num_timesteps if num_timesteps is not None else ended < num_episodes:  # type: ignore[operator]
            chosen, actions = self._choose(explore, random_actions, steps)
            result = self._try_env_step(actions)
            if result == ENV_STEP_FAILURE:  # the environments were made again, and start over
                return self._sample(
                    num_timesteps=num_timesteps,
                    num_episodes=num_episodes,
                    explore=explore,
                    random_actions=random_actions,
                    force_reset=True,
                )
            self._observations, rewards, terminated, truncated, info = result
            step = {**chosen, Columns.OBS: self._observations, Columns.REWARDS: rewards, _RESET: self._over}
            for name, values in {**step, Columns.TERMINATEDS: terminated, Columns.TRUNCATEDS: truncated}.items():
                columns[name].append(values)
            steps += self.num_envs - int(self._over.sum())
            self._over = terminated | truncated
            infos.append(info if self._over.any() else {})
            ended += int(self._over.sum())
        whole, parts = self._episodes({name: np.stack(rows, axis=1) for name, rows in columns.items()}, infos)
        if num_episodes is not None:
            whole, parts = whole[:num_episodes], []
        self._ended += [scores for _, scores in whole]
        self._log_env_steps(metric=self._metrics_num_env_steps_sampled, num_steps=steps)
        self._increase_sampled_metrics(steps, len(whole))
        return [episode for episode, _ in whole] + parts

    def _choose(self, explore: bool, random_actions: bool, steps: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Actions (N, n) with what else the module says of them, and the actions that the environment is to take."""
        chosen = {WEIGHTS_SEQ_NO: np.full(self.num_envs, self._weights_seq_no)}
        space = self.env.single_action_space
        if random_actions:
            actions = self.env.action_space.sample()
            return {**chosen, Columns.ACTIONS: actions}, actions
        batch = {Columns.OBS: convert_to_torch_tensor(self._observations, device=self._device)}
        with self.metrics.log_time(RLMODULE_INFERENCE_TIMER):
            if explore:
                runners = self.config.num_env_runners or 1
                so_far = (self.num_env_steps_sampled_lifetime // runners + steps) * runners
                output = self.module.forward_exploration(batch, t=so_far)
            else:
                output = self.module.forward_inference(batch)
        # the connector looks at the first episode, whether it is one of several agents
        output = self._get_actions(rl_module=self.module, batch=output, episodes=[None], explore=explore)
        chosen |= convert_to_numpy(output)
        actions = chosen[Columns.ACTIONS]
        if self.config.normalize_actions:
            return chosen, unsquash_action(actions, space)
        return chosen, clip_action(actions, space) if self.config.clip_actions else actions

    def _episodes(
        self, columns: dict[str, np.ndarray], infos: list[Mapping[str, Any]]
    ) -> tuple[list[Ended], list[SingleAgentEpisode]]:
        """Whole episodes, or the last chunks of them, in the order in which they ended; chunks of those under way.

        Args:
            columns: (N, T, ...) of each step; observations are (N, T + 1, size).
            infos: (T,) of the steps in which an episode ended.
        """
        now = time.perf_counter()
        whole: list[tuple[int, int, Ended]] = []
        parts: list[SingleAgentEpisode] = []
        resets, rewards = columns.pop(_RESET), columns[Columns.REWARDS]
        for i in range(self.num_envs):
            begin = 0
            for end in [*np.flatnonzero(resets[i]).tolist(), resets.shape[1]]:
                if end > begin:
                    chunk = self._chunk({name: values[i] for name, values in columns.items()}, i, begin, end)
                    self._lengths[i] += end - begin
                    self._returns[i] += rewards[i, begin:end].sum()
                    if chunk.is_done:
                        chunk.infos.data[-1] = _row(infos[end - 1], i)
                        scores = int(self._lengths[i]), float(self._returns[i]), now - float(self._begun[i])
                        whole.append((end, i, (chunk, scores)))
                        self._begin(np.array([i]))
                    else:
                        parts.append(chunk)
                begin = end + 1
        return [ended for *_, ended in sorted(whole, key=lambda place: place[:2])], parts

    def _chunk(self, steps: dict[str, np.ndarray], i: int, begin: int, end: int) -> SingleAgentEpisode:
        """Chunk of environment i's episode, from its steps (T, ...)."""
        taken = {name: values[begin:end] for name, values in steps.items()}
        own = (Columns.OBS, Columns.ACTIONS, Columns.REWARDS, Columns.TERMINATEDS, Columns.TRUNCATEDS)
        return SingleAgentEpisode(
            id_=self._ids[i],
            observations=steps[Columns.OBS][begin : end + 1],
            observation_space=self.env.single_observation_space,
            infos=[{} for _ in range(end - begin + 1)],
            actions=taken[Columns.ACTIONS],
            action_space=self.env.single_action_space,
            rewards=taken[Columns.REWARDS],
            terminated=bool(taken[Columns.TERMINATEDS][-1]),
            truncated=bool(taken[Columns.TRUNCATEDS][-1]),
            extra_model_outputs={name: values for name, values in taken.items() if name not in own},
            t_started=int(self._lengths[i]),
            len_lookback_buffer=0,
        )


def _row(infos: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Info of one environment, from those of the vector environment."""
    return {
        name: _row(value, i) if isinstance(value, Mapping) else value[i]
        for name, value in infos.items()
        if not name.startswith("_")
    }
