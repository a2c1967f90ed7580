"""Summary of the study: scores of its cells, and its checks."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.paper.methods import PAPER_METHODS
from baselines.paper.published import published
from baselines.paper.study import HORIZON, EpisodeScore
from satid_gym.laws import INERTIA_MODES
from satid_gym.profiles import PROFILES
from satid_gym.satellite import BENCHMARK_SATELLITES

MODES = INERTIA_MODES[1:]  # the time-varying ones


@dataclass(frozen=True, kw_only=True)
class CellScore:
    """Scores of one method in one cell, over its seeds; errors in %.

    Attributes:
        plant, profile, satellite, inertia_mode, method, horizon: the cell and the method.
        mean, std: mean and standard deviation of the error; NaN if a run did not identify the inertia.
        record_mean: mean error over the whole record.
        condition: mean condition number of the regression; None for filters.
        wheel_saturated: share of wheel-decisions at the speed limit.
        runs: number of episodes.
        not_identified: number of them without an estimate.
        paper: the paper's mean for its own two methods; None elsewhere.
    """

    plant: str
    profile: str
    satellite: str
    inertia_mode: str
    method: str
    horizon: float
    mean: float
    std: float
    record_mean: float
    condition: float | None
    wheel_saturated: float
    runs: int
    not_identified: int
    paper: float | None


def cells(runs: Sequence[EpisodeScore]) -> list[CellScore]:
    """Scores of the cells, in the order of the runs."""
    groups: dict[tuple[str, str, str, str, str, float], list[EpisodeScore]] = defaultdict(list)
    for run in runs:
        groups[run.plant, run.profile, run.satellite, run.inertia_mode, run.method, run.horizon].append(run)
    theirs = published()
    found = []
    for (plant, profile, satellite, mode, method, horizon), group in groups.items():
        errors = 100.0 * np.array([run.error for run in group])
        conditions = [run.condition for run in group if run.condition is not None]
        paper = theirs[profile, satellite, mode].get(method) if horizon == HORIZON else None
        found.append(
            CellScore(
                plant=plant,
                profile=profile,
                satellite=satellite,
                inertia_mode=mode,
                method=method,
                horizon=horizon,
                mean=float(errors.mean()),
                std=float(errors.std(ddof=1)) if len(errors) > 1 else 0.0,
                record_mean=float(100.0 * np.mean([run.record_error for run in group])),
                condition=float(np.mean(conditions)) if conditions else None,
                wheel_saturated=float(np.mean([run.wheel_saturated for run in group])),
                runs=len(group),
                not_identified=int(np.isnan(errors).sum()),
                paper=paper,
            )
        )
    return found


class CellTable:
    """Lookup of the cells with the horizon of the tables."""

    def __init__(self, found: Sequence[CellScore]) -> None:
        self._cells = {
            (c.plant, c.profile, c.satellite, c.inertia_mode, c.method): c for c in found if c.horizon == HORIZON
        }

    def __call__(self, profile: str, satellite: str, mode: str, method: str, plant: str = "varying") -> CellScore:
        """Scores of a method in a cell."""
        return self._cells[plant, profile, satellite, mode, method]


@dataclass(frozen=True, kw_only=True)
class Check:
    """Expected result of the study, and whether it was met."""

    claim: str
    found: str
    met: bool
    exceptions: tuple[str, ...] = ()


def checks(found: Sequence[CellScore]) -> list[Check]:
    """Checks of the study, from its cells."""
    table, theirs = CellTable(found), published()
    static = [(p, s) for s in BENCHMARK_SATELLITES for p in PROFILES]
    deviation = [abs(table(p, s, "static", "ls").mean / theirs[p, s, "static"]["ls"] - 1.0) for p, s in static]
    result = [
        Check(
            claim="LS, static: median relative distance from the paper's over 24 cells at most 0.15",
            found=f"{np.median(deviation):.3f}",
            met=bool(np.median(deviation) <= 0.15),
        ),
        _best_profiles(table),
    ]
    worse = [(p, s) for p, s in static if table(p, s, "static", "ekf").mean > theirs[p, s, "static"]["ekf"]]
    result.append(
        Check(
            claim="EKF, static: at most the paper's error in at least 20 of 24 cells",
            found=f"{24 - len(worse)}",
            met=len(worse) <= 4,
            exceptions=tuple(f"{s} {p}" for p, s in worse),
        )
    )
    dynamic = [(p, s, m) for m in MODES for s in BENCHMARK_SATELLITES for p in PROFILES]
    ours = {cell: table(*cell, "momentum_ekf").mean for cell in dynamic}
    large = [cell for cell in dynamic if not ours[cell] <= 0.5]
    above = [cell for cell in dynamic if not ours[cell] < min(theirs[cell][m] for m in PAPER_METHODS)]
    result += [
        Check(
            claim="MomentumEKF, truly varying plant: at most 0.5 % in at least 66 of 72 cells",
            found=f"{72 - len(large)}; largest {max(ours.values()):.3f} %",
            met=len(large) <= 6,
            exceptions=tuple(" ".join(cell) for cell in large),
        ),
        Check(
            claim="MomentumEKF, truly varying plant: below the paper's better estimator in at least 70 of 72 cells",
            found=f"{72 - len(above)}",
            met=len(above) <= 2,
            exceptions=tuple(" ".join(cell) for cell in above),
        ),
    ]
    return result


def _best_profiles(table: CellTable) -> Check:
    """Check that the paper's best profile of each satellite is among our best two."""
    theirs, parts, missed = published(), [], []
    for satellite in BENCHMARK_SATELLITES:
        best = min(PROFILES, key=lambda p: theirs[p, satellite, "static"]["ls"])
        ranked = sorted(PROFILES, key=lambda p: table(p, satellite, "static", "ls").mean)
        parts.append(f"{satellite}: {best} is number {ranked.index(best) + 1} of ours")
        if best not in ranked[:2]:
            missed.append(satellite)
    return Check(
        claim="LS, static: the paper's best profile of each satellite is among our best two",
        found="; ".join(parts),
        met=not missed,
        exceptions=tuple(missed),
    )


def finite(value: float | None) -> float | None:
    """Value for JSON: None if it is not finite."""
    return None if value is None or not math.isfinite(value) else value
