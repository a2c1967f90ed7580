"""Flights of a comparison: every entrant in every cell, and the tables of what came of them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.benchmark.cell import Cell
from agents.benchmark.entrants import Entrants
from agents.benchmark.report.curves import error_bands, rounded
from agents.benchmark.report.episode import episode_cell, fly_episode, shown_policies
from agents.benchmark.summary.statistics import PAIRED_KINDS, Scores, pair, record
from baselines.command import cluster
from satid_gym.evaluation import benchmark_scenario
from satid_gym.policy import Policy
from satid_gym.selection import label

Rows = list[dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Tables:
    """Rows of a comparison's tables, as compare.json and report_data.json have them.

    Attributes:
        records: scores of each policy in each cell.
        pairs: learned and closed-loop policies against every other one, on the same seeds.
        bounds: final errors that each cell allows; empty if the scenario's filter has no bounds.
        efficiencies: of each policy in each cell, with the time of its decisions, which is no result.
        curves: quantiles of each policy's error against time.
        limits: what each cell allows against time.
    """

    records: Rows = field(default_factory=list)
    pairs: Rows = field(default_factory=list)
    bounds: Rows = field(default_factory=list)
    efficiencies: Rows = field(default_factory=list)
    curves: Rows = field(default_factory=list)
    limits: Rows = field(default_factory=list)

    def add(self, cell: Cell, episodes: int) -> None:
        """Wait for a cell's flights and add its rows."""
        where = cell.place
        allowed = cell.performance_bound.result() if cell.performance_bound else None
        if allowed is not None:
            final = allowed.final_errors()
            self.bounds.extend(
                {"policy": name, "kind": "bound", **where, "final_error": error} for name, error in final.items()
            )
            self.limits.extend(
                {"policy": name, **where, "error": rounded(series)} for name, series in allowed.series().items()
            )
        scores: dict[str, Scores] = {}
        for policy, pending in zip(cell.policies, cell.flights, strict=True):
            flight, decision_ms = pending.result()
            scores[policy.name] = flight.scores()
            entry = {"policy": policy.name, "kind": policy.kind, **where, "episodes": episodes}
            self.records.append({**entry, **record(scores[policy.name])})
            self.curves.append({"policy": policy.name, **where, **error_bands(flight.error)})
            if allowed is not None:
                reached = {**allowed.efficiency(flight.error), "decision_ms": decision_ms}
                self.efficiencies.append({"policy": policy.name, **where, **reached})
        self.pairs.extend({**match, **where, **result} for match, result in _matches(cell.policies, scores))


def fly_cells(entrants: Entrants, seeds: Sequence[int], ray: str | None = None) -> Tables:
    """Fly every policy in every cell, as many flights at once as there are cores; shows the progress.

    Args:
        entrants: cells and policies.
        seeds: of the episodes.
        ray: address of a cluster whose cores fly; see `baselines.command.cluster`.
    """
    scenario, tables = benchmark_scenario(entrants.scenario), Tables()
    places = list(itertools.product(entrants.satellites, entrants.modes))
    total = sum(len(entrants.policies_for[satellite.name]) for satellite, _ in places)
    with (
        cluster.executor(ray) as pool,  # threads will do: flights are without the interpreter's lock most of the time
        tqdm(total=total, desc="comparing", unit="flight") as bar,
    ):
        cells = [
            Cell.start(
                pool,
                entrants.policies_for[satellite.name],
                satellite=satellite,
                inertia=mode,
                seeds=seeds,
                scenario=scenario,
                control=entrants.control,
            )
            for satellite, mode in places
        ]
        for pending in (flight for cell in cells for flight in cell.flights):
            pending.add_done_callback(lambda done: None if done.cancelled() else bar.update())
        while cells:
            cell = cells.pop(0)  # let go of its flights as soon as they are scored: all of them take much memory
            bar.set_postfix_str(" ".join(cell.place.values()), refresh=False)
            tables.add(cell, len(seeds))
    return tables


def fly_shown_episode(entrants: Entrants, records: Rows, seed: int) -> dict[str, Any]:
    """Fly the one episode that the report shows in full, with every policy."""
    names = [satellite.name for satellite in entrants.satellites]
    place = episode_cell(names, [label(mode) for mode in entrants.modes])
    satellite = next(s for s in entrants.satellites if s.name == place[0])
    mode = next(m for m in entrants.modes if label(m) == place[1])
    return fly_episode(
        entrants.policies_for[satellite.name],
        satellite=satellite,
        mode=mode,
        seed=seed,
        scenario=benchmark_scenario(entrants.scenario),
        control=entrants.control,
        shown=shown_policies([r for r in records if (r["satellite"], r["inertia_mode"]) == place]),
    )


def instants(entrants: Entrants) -> list[float]:
    """Times of the decisions, s, that curves are given at."""
    scenario = benchmark_scenario(entrants.scenario)
    times: list[float] = (scenario.decision_period * np.arange(1, scenario.decisions + 1)).tolist()
    return times


def _matches(policies: Sequence[Policy], scores: Mapping[str, Scores]) -> list[tuple[dict[str, str], dict[str, float]]]:
    return [
        ({"policy": one.name, "other": other.name}, pair(scores[one.name], scores[other.name]))
        for one in policies
        if one.kind in PAIRED_KINDS
        for other in policies
        if other is not one
    ]
