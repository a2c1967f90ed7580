"""SatInertiaID-v0, many at once: the same core over many rows, shared out among threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from satid_gym.config import check_flag, check_whole, unknown_name
from satid_gym.core import episode
from satid_gym.core.records import report_dtype
from satid_gym.estimators.belief import new_work
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.interface import (
    BROKEN,
    DRAW_FAILED,
    FLAGS,
    INFO_KEYS,
    make_spaces,
    option_templates,
    real_action,
    seed_stream,
)
from satid_gym.problem import (
    InertiaLike,
    SatelliteLike,
    ScenarioLike,
    Templates,
    build_templates,
    problem,
)
from satid_gym.reward import RewardSettings

_MODES = {
    AutoresetMode.NEXT_STEP: episode.NEXT_STEP,
    AutoresetMode.SAME_STEP: episode.SAME_STEP,
    AutoresetMode.DISABLED: episode.DISABLED,
}
_STATE = ("plants", "beliefs", "tasks", "reports", "observations")
_LEAST_ROWS = 16  # for a thread: below it handing over costs more than it gains


def _autoreset_mode(value: str | AutoresetMode) -> AutoresetMode:
    try:
        return AutoresetMode(value)
    except ValueError:
        raise unknown_name("autoreset mode", value, [mode.value for mode in AutoresetMode]) from None


class SatInertiaIDVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """`num_envs` independent copies of `SatInertiaIDEnv`, stepped together.

    Environment i of a vector seeded s equals the single environment seeded s + i, whatever the number of
    environments and threads. See `SatInertiaIDEnv` for spaces, reward and settings.

    Args:
        num_envs: how many.
        satellite, inertia, scenario, estimator, reward, max_episode_steps, include_covariance: as in
            `SatInertiaIDEnv`; the estimator is a compiled one.
        autoreset_mode: Gymnasium's; NEXT_STEP (default), SAME_STEP, or DISABLED with
            `reset(options={"reset_mask": mask})`.
        num_threads: the most threads to use; all cores where None.
        stagger: start the episodes of the first reset with less time left, evenly spread, so that later
            resets do not all fall on one step. For training.

    Raises:
        ValueError: a name is unknown or a value is not valid.
    """

    def __init__(
        self,
        num_envs: int = 1,
        satellite: SatelliteLike = "microsat",
        inertia: InertiaLike = "random",
        scenario: ScenarioLike = "default",
        estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
        reward: str | Mapping[str, Any] | RewardSettings | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        num_threads: int | None = None,
        stagger: bool = False,
        render_mode: str | None = None,
        include_covariance: bool = False,
    ) -> None:
        super().__init__()
        self.num_envs = check_whole("num_envs", num_envs)
        if num_threads is not None:
            num_threads = check_whole("num_threads", num_threads)
        if render_mode is not None:
            raise ValueError(
                f"unknown render mode {render_mode!r} of the vector environment: it draws nothing, so expected None; "
                'the single environment does, also with gymnasium.make_vec(..., vectorization_mode="sync")'
            )
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self.problem = problem(satellite, inertia, scenario, estimator, reward, max_episode_steps, include_covariance)
        self.stagger = check_flag("stagger", stagger)
        self._templates = build_templates(self.problem)
        n, rows = self.problem.wheels, self.num_envs
        self._plants = np.zeros(rows, self._templates.plants.dtype)
        self._beliefs = np.zeros(rows, self._templates.beliefs.dtype)
        self._tasks = np.zeros(rows, self._templates.tasks.dtype)
        self._reports = np.zeros(rows, report_dtype(n))
        self._final_reports = np.zeros(rows, report_dtype(n))
        self.single_observation_space, self.single_action_space = make_spaces(self.problem)
        self.observation_space = batch_space(self.single_observation_space, rows)
        self.action_space = batch_space(self.single_action_space, rows)
        size, n = self.single_observation_space.shape[0], self.problem.wheels
        self._observations = np.zeros((rows, size), np.float32)
        self._final_observations = np.zeros_like(self._observations)
        self._actions = np.zeros((rows, n), np.float32)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int | None] = [None] * rows
        self._tasks["over"] = 1
        self._set_threads(num_threads)
        self._in_use = threading.Lock()

    def _set_threads(self, num_threads: int | None) -> None:
        most = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        count = max(1, min(num_threads or most, self.num_envs // _LEAST_ROWS))
        edges = np.linspace(0, self.num_envs, count + 1).astype(int).tolist()
        self._shares = list(pairwise(edges))
        self._work = [new_work(self._beliefs) for _ in self._shares]
        self._pool: ThreadPoolExecutor | None = None
        self._pool_process = 0

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_in_use"} | {"_pool": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._in_use = threading.Lock()

    @contextmanager
    def _used_alone(self) -> Iterator[None]:
        """Refuse a second thread while one is in `reset` or `step`: both write the same rows.

        Raises:
            RuntimeError: another thread is in one of them.
        """
        if not self._in_use.acquire(blocking=False):
            raise RuntimeError(
                "two threads are in reset() or step() of one vector environment at once: give each thread an "
                "environment of its own (it uses all cores by itself), or put a lock around every call"
            )
        try:
            yield
        finally:
            self._in_use.release()

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """Seeds of the environments; None where one was drawn from the operating system."""
        return tuple(self._seeds)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Generators that the environments' streams were started from."""
        return tuple(self._generators)

    @property
    def satellite_index(self) -> np.ndarray:
        """(num_envs,) which of `problem.satellites`, or of the last reset's option, each environment flies."""
        return self._tasks["template"].copy()

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode in every environment, or in those of a mask.

        Args:
            seed: s gives environment i the seed s + i; a list gives each its own.
            options: those of the single environment, for these episodes alone, and `reset_mask`
                ((num_envs,) bool).

        Returns:
            Observations (num_envs, size) and infos.

        Raises:
            ValueError: an option, the mask or the number of seeds is not valid; nothing has changed.
            RuntimeError: another thread is in `reset` or `step`.
        """
        with self._used_alone():
            return self._reset(seed, options)

    def _reset(
        self, seed: int | Sequence[int | None] | None, options: dict[str, Any] | None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        if options is not None and not isinstance(options, Mapping):
            raise ValueError(f"reset options must be a mapping, got {options!r}")
        options = dict(options or {})
        mask = self._mask(options.pop("reset_mask", None))
        templates = option_templates(self.problem, options) if options else self._templates
        self._seed(seed, mask)
        if self._run(episode.BEGIN, templates, mask.astype(np.int8)):
            self._tasks["over"][mask] = 1
            raise ValueError(DRAW_FAILED)
        if self.stagger:
            rows = np.flatnonzero(mask)
            self._tasks["decision"][rows] = np.arange(len(rows)) * self._tasks["decisions"][rows] // len(rows)
            self.stagger = False
        return self._observations.copy(), self._infos(self._reports, mask)

    def _mask(self, mask: Any) -> np.ndarray:
        if mask is None:
            return np.ones(self.num_envs, bool)
        mask = np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ValueError(
                f"reset_mask must be a boolean array of shape ({self.num_envs},) with at least one True, "
                f"got {mask.dtype} {mask.shape}"
            )
        return mask

    def _seed(self, seed: int | Sequence[int | None] | None, mask: np.ndarray) -> None:
        """Start the streams of the masked environments that get a seed or have none yet."""
        if seed is None:
            seeds: list[int | None] = [None] * self.num_envs
        elif isinstance(seed, (Sequence, np.ndarray)) and not isinstance(seed, str):
            seeds = [int(s) if isinstance(s, np.integer) else s for s in seed]
        elif isinstance(seed, (int, np.integer)):
            seeds = [int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = [seed] * self.num_envs  # Gymnasium's own generator refuses it below
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be one number or {self.num_envs} of them, got {len(seeds)}")
        first = not self._generators
        # all of them before any is kept: a seed that is refused leaves the others as they were
        fresh = {
            i: seeding.np_random(seed)[0] for i, seed in enumerate(seeds) if first or (mask[i] and seed is not None)
        }
        if first:
            self._generators = [fresh[i] for i in range(self.num_envs)]
        for i, generator in fresh.items():
            self._seeds[i] = seeds[i]
            self._generators[i] = generator
            self._plants["stream"][i] = seed_stream(generator)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take one decision in every environment.

        Args:
            actions: (num_envs, n) motor torque as fraction of the limit; cut to [-1, 1].

        Returns:
            Observations, rewards, terminations, truncations, infos.

        Raises:
            ValueError: the actions are not finite or have another shape; nothing has changed.
            gymnasium.error.ResetNeeded: an episode is over and autoreset is disabled, or nothing was reset yet.
            FloatingPointError: a filter broke down.
            RuntimeError: another thread is in `reset` or `step`.
        """
        with self._used_alone():
            return self._step(actions)

    def _step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        actions = real_action("actions", actions)
        if actions.shape != self._actions.shape:
            raise ValueError(f"actions must have shape {self._actions.shape}, got {actions.shape}")
        if not np.isfinite(actions).all():
            wrong = np.flatnonzero(~np.isfinite(actions).all(axis=1)).tolist()
            raise ValueError(f"actions must be finite; rows {wrong} are not")
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        same = self.autoreset_mode is AutoresetMode.SAME_STEP
        if self.autoreset_mode is AutoresetMode.DISABLED and self._tasks["over"].any():
            raise gymnasium.error.ResetNeeded(
                f"episodes {np.flatnonzero(self._tasks['over']).tolist()} are over: "
                "call reset(options={'reset_mask': mask}) before step()"
            )
        self._actions[:] = actions
        if self._run(_MODES[self.autoreset_mode], self._templates, np.zeros(self.num_envs, np.int8)):
            raise FloatingPointError(BROKEN if self._beliefs["broken"].any() else DRAW_FAILED)
        if not np.isfinite(self._observations).all():
            raise FloatingPointError(BROKEN)
        reports = self._reports
        terminations, truncations = reports["terminated"].astype(bool), reports["truncated"].astype(bool)
        infos = self._infos(reports, np.ones(self.num_envs, bool))
        over = terminations | truncations
        if same and over.any():
            final = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(over):
                final[i] = self._final_observations[i].copy()
            infos |= {"final_obs": final, "_final_obs": over.copy()}
            infos |= {"final_info": self._infos(self._final_reports, over), "_final_info": over.copy()}
        return self._observations.copy(), reports["reward"].copy(), terminations, truncations, infos

    def _infos(self, reports: np.ndarray, mask: np.ndarray) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        partial = not mask.all()
        for key in INFO_KEYS:
            value = reports[key].astype(bool) if key in FLAGS else reports[key].copy()
            if partial:
                value[~mask] = 0
            infos[key], infos[f"_{key}"] = value, mask.copy()
        return infos

    def _run(self, mode: int, templates: Templates, chosen: np.ndarray) -> int:
        """One call of the core on all rows; the number of rows that failed."""
        pool = self._threads()
        if pool is None:
            return self._run_share(0, mode, templates, chosen)
        others = range(1, len(self._shares))
        futures = [pool.submit(self._run_share, i, mode, templates, chosen) for i in others]
        failed = self._run_share(0, mode, templates, chosen)
        return failed + sum(future.result() for future in futures)

    def _threads(self) -> ThreadPoolExecutor | None:
        """The pool, made anew after a fork or a copy."""
        if len(self._shares) == 1:
            return None
        if self._pool is None or self._pool_process != os.getpid():
            self._pool = ThreadPoolExecutor(len(self._shares) - 1, thread_name_prefix="satid-gym")
            self._pool_process = os.getpid()
        return self._pool

    def _run_share(self, share: int, mode: int, templates: Templates, chosen: np.ndarray) -> int:
        return episode.step_many(
            *self._shares[share],
            mode,
            chosen,
            self._actions,
            templates.draws,
            templates.records,
            self._plants,
            self._beliefs,
            self._tasks,
            self._work[share],
            self._reports,
            self._observations,
            self._final_reports,
            self._final_observations,
        )

    def state(self) -> dict[str, np.ndarray]:
        """Every number the environments go on from; truth and belief are in it, so it is not for policies."""
        return {name: getattr(self, f"_{name}").copy() for name in _STATE}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go back to a `state` of a vector with the same settings.

        Raises:
            ValueError: an array is missing or of another type or shape; nothing has changed.
        """
        if not isinstance(state, Mapping):
            raise ValueError(f"state must be what state() returned, got {type(state).__name__}")
        for name in _STATE:
            own = getattr(self, f"_{name}")
            if name not in state or state[name].dtype != own.dtype or state[name].shape != own.shape:
                raise ValueError(
                    f"state has no {name} of shape {own.shape} and the right fields: it is of other settings"
                )
        if not self._generators:
            self._seed(None, np.ones(self.num_envs, bool))
        for name in _STATE:
            getattr(self, f"_{name}")[:] = state[name]
        self.stagger = False

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
