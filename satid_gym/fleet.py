"""Fleet of environments: their records, and the threads that start and step them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from satid_gym.core import episode
from satid_gym.core.records import Autoreset, Final, Rows, Templates, log_dtype, report_dtype
from satid_gym.estimators.records import new_work
from satid_gym.problem import Problem
from satid_gym.templates import build_templates

_STATE = ("plants", "beliefs", "tasks", "reports", "observations")
_ROWS_MIN = 16  # for a thread: below it handing over costs more than it gains
DRAW_FAILED = (
    "no physical inertia tensor in 1000 draws: the nominal tensor is too close to the "
    "triangle inequality for this inertia_std, tilt_std or law; lower them or change the satellite"
)
_BROKEN = (
    "the filter broke down: its covariance is no longer positive definite, or its estimate not finite; "
    "sample more often, give sensors some noise, or check the estimator's settings"
)


class Fleet:
    """N environments of one problem. Truth and belief are in its rows, so it is not for policies.

    Args:
        problem: what each of them poses.
        count: N.
        num_threads: the most threads to use; all cores where None.
        log: whether `rows.logs` keeps every sample of the last decision, at its start the first.

    Attributes:
        problem: as given.
        templates: what episodes start from.
        rows: records of the environments.
        final: report and observation of episodes that ended in the last step and were followed by new ones.
    """

    def __init__(self, problem: Problem, count: int, *, num_threads: int | None = 1, log: bool = False) -> None:
        self.problem = problem
        self.templates = build_templates(problem)
        plants, beliefs, tasks = (part.dtype for part in self.templates.records[1:])
        n, size = problem.wheels, max(place.stop for place in problem.layout.values())
        p = beliefs["prior_theta"].shape[0]
        reports = report_dtype(n, plants["oscillators"]["mass"].shape[0])
        self.rows = Rows(
            plants=np.zeros(count, plants),
            beliefs=np.zeros(count, beliefs),
            tasks=np.zeros(count, tasks),
            reports=np.zeros(count, reports),
            observations=np.zeros((count, size), np.float32),
            logs=np.zeros((count, problem.scenario.samples if log else 0), log_dtype(n, p)),
        )
        self.final = Final(np.zeros(count, reports), np.zeros((count, size), np.float32))
        self.rows.tasks["over"] = 1
        self._actions = np.zeros((count, problem.actions), np.float32)
        self._all, self._none = np.ones(count, bool), np.zeros(count, bool)
        most = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        shares = max(1, min(num_threads or most, count // _ROWS_MIN))
        self._spans = list(pairwise(np.linspace(0, count, shares + 1).astype(int).tolist()))
        self._work = [new_work(self.rows.beliefs) for _ in self._spans]
        self._pool: ThreadPoolExecutor | None = None
        self._pool_process = 0

    def __len__(self) -> int:
        return len(self.rows.plants)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pool": None}

    @property
    def work(self) -> np.ndarray:
        """(1,) scratch space of the first thread."""
        return self._work[0]

    def begin(self, chosen: np.ndarray | None = None, templates: Templates | None = None) -> None:
        """Start episodes in the chosen rows (N,) bool or in all, from these templates or the fleet's own.

        Raises:
            ValueError: no inertia drawn is physical; the chosen episodes are over.
        """
        chosen = self._all if chosen is None else chosen
        if self._run(Autoreset.BEGIN, chosen, self._actions, templates or self.templates.records):
            self.rows.tasks["over"][chosen] = 1
            raise ValueError(DRAW_FAILED)

    def step(self, actions: np.ndarray, mode: Autoreset = Autoreset.DISABLED) -> None:
        """One decision of every row, with actions (N, n) float32, and the new episodes that `mode` asks for.

        Raises:
            FloatingPointError: a filter broke down, or no inertia drawn for a new episode is physical.
        """
        self.check(self._run(mode, self._none, actions, self.templates.records))

    def check(self, failed: int = 0) -> None:
        """Refuse failed rows, and observations that are not finite.

        Raises:
            FloatingPointError: see `step`.
        """
        if failed:
            raise FloatingPointError(_BROKEN if self.rows.beliefs["broken"].any() else DRAW_FAILED)
        if not np.isfinite(self.rows.observations).all():
            raise FloatingPointError(_BROKEN)

    def _run(self, mode: Autoreset, chosen: np.ndarray, actions: np.ndarray, templates: Templates) -> int:
        """One call of the core on all rows; the number of rows that failed."""
        pool = self._threads()

        def share(i: int) -> int:
            return episode.step_many(
                self._spans[i], int(mode), chosen, actions, self.rows, templates, self._work[i], self.final
            )

        if pool is None:
            return share(0)
        futures = [pool.submit(share, i) for i in range(1, len(self._spans))]
        failed = share(0)
        return failed + sum(future.result() for future in futures)

    def _threads(self) -> ThreadPoolExecutor | None:
        """The pool, started again after a fork or a copy."""
        if len(self._spans) == 1:
            return None
        if self._pool is None or self._pool_process != os.getpid():
            self._pool = ThreadPoolExecutor(len(self._spans) - 1, thread_name_prefix="satid-gym")
            self._pool_process = os.getpid()
        return self._pool

    def state(self) -> dict[str, np.ndarray]:
        """All numbers from which the environments continue."""
        return {name: getattr(self.rows, name).copy() for name in _STATE}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go back to a `state` of a fleet with the same settings.

        Raises:
            ValueError: an array is missing or of another type or shape; nothing has changed.
        """
        if not isinstance(state, Mapping):
            raise ValueError(f"state must be what state() returned, got {type(state).__name__}")
        for name in _STATE:
            own = getattr(self.rows, name)
            if name not in state or state[name].dtype != own.dtype or state[name].shape != own.shape:
                raise ValueError(
                    f"state has no {name} of shape {own.shape} and the right fields: it is of other settings"
                )
        for name in _STATE:
            getattr(self.rows, name)[:] = state[name]

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
