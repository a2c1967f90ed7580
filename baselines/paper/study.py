"""Jobs of the study, run in parallel processes, and the scores of each estimator on each episode."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from baselines.paper.flight import ProfileFlight, fly_profile
from baselines.paper.methods import METHODS, Estimate, estimate
from satid_gym import metrics
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.evaluation import seeds
from satid_gym.laws import INERTIA_MODES, InertiaMode, paper_law
from satid_gym.plants import law_inertia
from satid_gym.profiles import PROFILES
from satid_gym.satellite import BENCHMARK_SATELLITES

PLANTS = ("varying", "constant")
HORIZON = 300.0  # s, of the tables
HORIZONS = (10.0, 20.0, 30.0, 60.0, 100.0, 150.0, 200.0, 300.0, 450.0, 600.0)  # s, of the figure
HORIZON_METHODS = ("ls", "ekf", "momentum_ls", "momentum_ekf")


@dataclass(frozen=True, kw_only=True)
class EpisodeScore:
    """Errors of one estimator on one episode.

    Attributes:
        plant: "varying", or "constant" if the plant kept its first inertia and was scored against `inertia_mode`.
        profile, satellite, inertia_mode, method, seed: the episode and the estimator.
        horizon: s.
        error: the paper's metric: relative error at the end (static), or its mean over the last 20 % (else).
        record_error: mean relative error over the whole record.
        condition: condition number of the regression, for batch estimators.
        wheel_saturated: share of wheel-decisions at the speed limit.
    """

    plant: str
    profile: str
    satellite: str
    inertia_mode: InertiaMode
    method: str
    seed: int
    horizon: float
    error: float
    record_error: float
    condition: float | None
    wheel_saturated: float


@dataclass(frozen=True, kw_only=True)
class Job:
    """Episodes of one profile in one cell."""

    profile: str
    satellite: str
    inertia_mode: InertiaMode
    horizon: float
    methods: tuple[str, ...]
    seeds: tuple[int, ...]

    def runs(self) -> list[EpisodeScore]:
        """Scores of all episodes; a static plant is scored against the varying truths as well."""
        flight = fly_profile(self.satellite, self.inertia_mode, self.profile, self.seeds, self.horizon)
        scored: list[EpisodeScore] = []
        for row, seed in enumerate(self.seeds):
            found = estimate(flight, row, self.methods)
            scored += self._score(flight, row, seed, found, "varying", self.inertia_mode, flight.inertia[:, row])
            if self.inertia_mode != "static" or self.horizon != HORIZON:
                continue
            for mode in INERTIA_MODES[1:]:
                varying = law_inertia(paper_law(mode, self.horizon), flight.inertia[0, row], flight.time)
                scored += self._score(flight, row, seed, found, "constant", mode, varying)
        return scored

    def _score(
        self,
        flight: ProfileFlight,
        row: int,
        seed: int,
        found: dict[str, Estimate],
        plant: str,
        mode: InertiaMode,
        truth: np.ndarray,
    ) -> Iterator[EpisodeScore]:
        for method, estimated in found.items():
            error = metrics.relative_error(inertia_tensors(estimated.inertia), truth)[1:]
            yield EpisodeScore(
                plant=plant,
                profile=self.profile,
                satellite=self.satellite,
                inertia_mode=mode,
                method=method,
                seed=seed,
                horizon=self.horizon,
                error=float(error[-1] if mode == "static" else metrics.final_error(error)),
                record_error=float(error.mean()),
                condition=estimated.condition,
                wheel_saturated=float(flight.saturated[:, row].mean()),
            )


def table_jobs(count: int) -> list[Job]:
    """Jobs of the tables: every profile, satellite and inertia mode with every method."""
    return [
        Job(
            profile=profile,
            satellite=satellite,
            inertia_mode=mode,
            horizon=HORIZON,
            methods=tuple(METHODS),
            seeds=tuple(seeds("test", count)),
        )
        for mode in INERTIA_MODES
        for satellite in BENCHMARK_SATELLITES
        for profile in PROFILES
    ]


def horizon_jobs(count: int) -> list[Job]:
    """Jobs of the horizon figure: every profile and satellite with static inertia over the other horizons."""
    return [
        Job(
            profile=profile,
            satellite=satellite,
            inertia_mode="static",
            horizon=horizon,
            methods=HORIZON_METHODS,
            seeds=tuple(seeds("test", count)),
        )
        for horizon in HORIZONS
        if horizon != HORIZON
        for satellite in BENCHMARK_SATELLITES
        for profile in PROFILES
    ]


def run_all(jobs: Iterable[Job]) -> list[EpisodeScore]:
    """Scores of all jobs, in their order, computed on all cores available to this process."""
    jobs = list(jobs)
    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(Job.runs, job) for job in jobs]
        for future in tqdm(as_completed(futures), total=len(futures), desc="study", unit="profile", mininterval=1.0):
            future.result()
    return [run for future in futures for run in future.result()]
