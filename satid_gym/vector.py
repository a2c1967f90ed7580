"""SatInertiaID-v0, many at once: the same core over many rows, shared out among threads."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from satid_gym.config import check_flag, check_integer, unknown_name
from satid_gym.core.observation import Form
from satid_gym.core.records import Autoreset
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.fleet import Fleet
from satid_gym.gym_api import infos_of, make_spaces, option_templates, real_action, seed_list, seed_stream
from satid_gym.problem import problem
from satid_gym.resolution import InertiaLike, SatelliteLike, ScenarioLike
from satid_gym.reward import RewardSettings


def _autoreset_mode(value: str | AutoresetMode) -> AutoresetMode:
    """The mode by the name of Gymnasium's member, such as SAME_STEP, or by its value, SameStep."""
    for mode in AutoresetMode:
        if value in (mode, mode.name, mode.value):
            return mode
    raise unknown_name("autoreset mode", value, [mode.name for mode in AutoresetMode])


class SatInertiaIDVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """`num_envs` independent copies of `SatInertiaIDEnv`, stepped together.

    Environment i of a vector seeded s equals the single environment seeded s + i, whatever the number of
    environments and threads. See `SatInertiaIDEnv` for spaces, reward and settings.

    Args:
        num_envs: number of environments.
        satellite, inertia, scenario, estimator, reward, max_episode_steps: as in `SatInertiaIDEnv`; the estimator is a
            compiled one.
        include_covariance, control, observation, include_walk: as in `SatInertiaIDEnv`.
        render_mode, truth: must be None.
        autoreset_mode: Gymnasium's; NEXT_STEP (default), SAME_STEP, or DISABLED with
            `reset(options={"reset_mask": mask})`.
        num_threads: largest number of threads; None: all cores.
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
        control: str = "torque",
        observation: Form = "wheels",
        include_walk: bool = False,
        truth: None = None,
    ) -> None:
        super().__init__()
        if truth is not None:
            raise ValueError(
                f"truth {truth!r} moves one satellite, and the vector environment is compiled as a whole: expected "
                'None; make the single environment with it, gymnasium.make("SatInertiaID-v0", truth=...)'
            )
        self.num_envs = check_integer("num_envs", num_envs)
        if num_threads is not None:
            num_threads = check_integer("num_threads", num_threads)
        if render_mode is not None:
            raise ValueError(
                f"unknown render mode {render_mode!r} of the vector environment: it draws nothing, so expected None; "
                'the single environment does, also with gymnasium.make_vec(..., vectorization_mode="sync")'
            )
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self.problem = problem(
            satellite,
            inertia,
            scenario,
            estimator,
            reward,
            max_episode_steps,
            include_covariance,
            control,
            observation,
            include_walk,
        )
        self.stagger = check_flag("stagger", stagger)
        self.fleet = Fleet(self.problem, self.num_envs, num_threads=num_threads)
        self.single_observation_space, self.single_action_space = make_spaces(self.problem)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int | None] = [None] * self.num_envs
        self._in_use = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_in_use"}

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
    def layout(self) -> dict[str, slice]:
        """Places of the parts of one environment's observation by name: `observations[:, layout["rate"]]`."""
        return self.problem.layout

    @property
    def satellite_index(self) -> np.ndarray:
        """(num_envs,) which of `problem.satellites`, or of the last reset's option, each environment flies."""
        return self.fleet.rows.tasks["template"].copy()

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
        templates = option_templates(self.problem, options) if options else self.fleet.templates
        self._seed(seed, mask)
        self.fleet.begin(mask, templates.records)
        rows = self.fleet.rows
        if self.stagger:
            begun = np.flatnonzero(mask)
            rows.tasks["decision"][begun] = np.arange(len(begun)) * rows.tasks["decisions"][begun] // len(begun)
            self.stagger = False
        return rows.observations.copy(), infos_of(rows.reports, mask)

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
        seeds = seed_list(seed, self.num_envs)
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
            self.fleet.rows.plants["stream"][i] = seed_stream(generator)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take one decision in every environment.

        Args:
            actions: (num_envs, n) motor torque, or (num_envs, 3) body rate, as fraction of the limit; cut to
                [-1, 1].

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
        if actions.shape != self.action_space.shape:
            raise ValueError(f"actions must have shape {self.action_space.shape}, got {actions.shape}")
        if not np.isfinite(actions).all():
            wrong = np.flatnonzero(~np.isfinite(actions).all(axis=1)).tolist()
            raise ValueError(f"actions must be finite; rows {wrong} are not")
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        rows, final = self.fleet.rows, self.fleet.final
        if self.autoreset_mode is AutoresetMode.DISABLED and rows.tasks["over"].any():
            raise gymnasium.error.ResetNeeded(
                f"episodes {np.flatnonzero(rows.tasks['over']).tolist()} are over: "
                "call reset(options={'reset_mask': mask}) before step()"
            )
        self.fleet.step(actions, Autoreset[self.autoreset_mode.name])
        reports = rows.reports
        terminations, truncations = reports["terminated"].astype(bool), reports["truncated"].astype(bool)
        infos = infos_of(reports, np.ones(self.num_envs, bool))
        over = terminations | truncations
        if self.autoreset_mode is AutoresetMode.SAME_STEP and over.any():
            observations = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(over):
                observations[i] = final.observations[i].copy()
            infos |= {"final_obs": observations, "_final_obs": over.copy()}
            infos |= {"final_info": infos_of(final.reports, over), "_final_info": over.copy()}
        return rows.observations.copy(), reports["reward"].copy(), terminations, truncations, infos

    def state(self) -> dict[str, np.ndarray]:
        """All numbers from which the environments continue; it contains the truth, so it is not for policies."""
        return self.fleet.state()

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go back to a `state` of a vector with the same settings.

        Raises:
            ValueError: an array is missing or of another type or shape; nothing has changed.
        """
        self.fleet.restore(state)
        if not self._generators:  # so that step() is allowed and later resets draw
            streams = self.fleet.rows.plants["stream"].copy()
            self._seed(None, np.ones(self.num_envs, bool))
            self.fleet.rows.plants["stream"] = streams
        self.stagger = False

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        self.fleet.close()
