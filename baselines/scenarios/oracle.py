"""Oracle of a gate: it flies the true episode again and again, and searches the plan of each.

A plan is a baseline with settings of its own for each episode, told the truth about what is hidden there; these are
found by the cross-entropy method. Where wheels avoid a band of speed a plan is the body rates themselves, and evolves
from flights of the best laws.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cluster
from baselines.scenarios.flights import Cell, Flown, flown
from baselines.scenarios.plans.corner import CornerPlan
from baselines.scenarios.plans.rates import RatesPlan, Recorder, edited, starts
from baselines.scenarios.plans.shaped import ShapedPlan
from baselines.scenarios.plans.swing import SwingPlan
from baselines.scenarios.plans.window import WindowPlan

_SettingsPlan = CornerPlan | ShapedPlan | SwingPlan | WindowPlan
_EFFORT = {"slosh": (64, 12), "wheels4": (96, 40)}  # population and rounds, for each episode
_EFFORT_ELSE = (32, 6)
_ELITE = 0.25  # of the population
_PARENTS = 16  # plans of rates that evolve further
_SPREAD = 0.6  # std of the first population about the typical settings
_STRAY = 100.0  # by which a cost beyond its limit counts in the search


PLANS: dict[str, type[_SettingsPlan | RatesPlan]] = {
    "flex": ShapedPlan,
    "slosh": CornerPlan,
    "calibration": SwingPlan,
    "operations": WindowPlan,
    "wheels4": RatesPlan,
}
"""Plan that the oracle searches, by scenario: rates, or a policy of points (N, size), 0 the typical one."""


def effort(scenario: str) -> tuple[int, int]:
    """Population and rounds of the search in a scenario."""
    return _EFFORT.get(scenario, _EFFORT_ELSE)


def search(
    cell: Cell,
    seeds: Sequence[int],
    limit: float,
    population: int | None = None,
    rounds: int | None = None,
    ray: str | None = None,
) -> Flown:
    """Best flight of each episode that was found.

    Args:
        cell: what is flown.
        seeds: of the episodes.
        limit: of each cost.
        population: plans that are flown of each episode in a round; None: as `effort` says.
        rounds: how often; None: likewise.
        ray: address of a cluster that searches, an episode a task; see `baselines.command.cluster`.
    """
    usual = effort(cell.scenario)
    population = usual[0] if population is None else population
    rounds = usual[1] if rounds is None else rounds
    plan = PLANS[cell.scenario]
    if issubclass(plan, RatesPlan):
        return _joined(_evolve, [(cell, seed, limit, population, rounds) for seed in seeds], ray)
    draws = np.random.default_rng(0).standard_normal((rounds, len(seeds), population, plan.size))
    if ray is None:
        return _search(cell, seeds, limit, draws, plan)
    return _joined(_search, [(cell, [seed], limit, draws[:, [i]], plan) for i, seed in enumerate(seeds)], ray)


def _joined(task: Callable[..., Flown], calls: Sequence[tuple[Any, ...]], ray: str | None) -> Flown:
    """Flights of all calls, an episode each."""
    flights = list(cluster.each(task, calls, ray, desc="oracle", unit="episode"))
    return Flown(*(np.concatenate([getattr(f, name) for f in flights]) for name in Flown.__dataclass_fields__))


def _evolve(cell: Cell, seed: int, limit: float, population: int, rounds: int) -> Flown:
    """Rates of one episode, from those of the best laws: in each round of edits of the best plans so far."""
    rng, begun = np.random.default_rng(seed), []
    for policy in starts():
        recorder = Recorder(policy)
        flown(cell, recorder, [seed])
        begun.append(recorder.rates[0])
    plans, values = np.array(begun), np.full(len(begun), np.inf)
    best: Flown | None = None
    for _ in range(rounds):
        tried = np.array([edited(plans[rng.integers(len(plans))], plans, rng) for _ in range(population)])
        if best is None:
            tried[: len(plans)] = plans[:population]
        flight = flown(cell, RatesPlan(tried), [seed] * population)
        value = _value(flight, limit)
        here = flight.take(np.array([np.argmin(value)]))
        best = here if best is None else _better(best, here, limit)
        plans, values = np.concatenate([plans, tried]), np.concatenate([values, value])
        chosen = np.argsort(values)[:_PARENTS]
        plans, values = plans[chosen], values[chosen]
    assert best is not None
    return best


def _search(cell: Cell, seeds: Sequence[int], limit: float, draws: np.ndarray, kind: type[_SettingsPlan]) -> Flown:
    """The search of these episodes, each by itself, from normal draws (rounds, episodes, population, size)."""
    _, episodes, population, size = draws.shape
    mean, std = np.zeros((episodes, 1, size)), np.full((episodes, 1, size), _SPREAD)
    best: Flown | None = None
    for drawn in tqdm(draws, desc="oracle", unit="round"):
        points = mean + std * drawn
        points[:, 0] = mean[:, 0]
        plan = kind(points.reshape(-1, size))
        flight = flown(cell, plan, np.repeat(seeds, population).tolist(), plan.told)
        order = np.argsort(_value(flight, limit).reshape(episodes, -1), axis=1)
        here = flight.take(order[:, 0] + population * np.arange(episodes))
        best = here if best is None else _better(best, here, limit)
        elite = np.take_along_axis(points, order[:, : max(1, round(_ELITE * population)), None], axis=1)
        mean, std = elite.mean(axis=1, keepdims=True), 0.5 * std + 0.5 * elite.std(axis=1, keepdims=True)
    assert best is not None
    return best


def _value(flight: Flown, limit: float) -> np.ndarray:
    """What the search minimises: the expected error, more where a cost is beyond its limit."""
    return flight.expected * (1.0 + _STRAY * np.maximum(flight.costs - limit, 0.0).max(axis=1))


def _better(one: Flown, other: Flown, limit: float) -> Flown:
    """Episode by episode the better of two flights."""
    take = _value(other, limit) < _value(one, limit)
    return Flown(
        *(
            np.where(take.reshape(-1, *[1] * (getattr(one, name).ndim - 1)), getattr(other, name), getattr(one, name))
            for name in one.__dataclass_fields__
        )
    )
