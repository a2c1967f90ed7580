"""Oracle of a gate: it is told the true modes, and searches the settings of each episode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.scenarios.flights import Cell, Flown, flown
from satid_gym.core.observation import MODE_PARTS
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.vector import SatInertiaIDVectorEnv

_POPULATION, _ELITE, _ROUNDS = 32, 8, 6  # of the search, for each episode
_STRAY = 100.0  # by which a cost beyond its limit counts in the search


def with_true_modes(env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
    """Observations in which the modes' frequency and deflection are the true ones, known exactly."""
    rows, places = env.fleet.rows, dict(zip(MODE_PARTS, np.cumsum([0, *MODE_PARTS.values()]).tolist(), strict=False))
    modes, told = rows.beliefs["modes"], observation.copy()
    part = told[:, env.problem.layout["modes"]].reshape(len(told), -1, sum(MODE_PARTS.values()))
    o = rows.plants["oscillators"]
    period = env.problem.scenario.decision_period
    by_limit = part[:, 0, places["deflection_limit"]] / rows.tasks["deflection_limit"][:, 0]
    mean, rate = (o[name].mean(axis=1) for name in ("deflection", "speed"))  # of the pair
    if np.isfinite(rows.tasks["deflection_limit"]).all():
        part[:, 0, places["deflection"]] = mean * by_limit
        part[:, 0, places["deflection_rate"]] = rate / modes["frequency"][:, 0] * by_limit
    part[:, 0, places["frequency"]] = modes["frequency"][:, 0] * o["scale"][:, 0, 1] * period / (2.0 * np.pi)
    part[:, 0, places["frequency_std"]] = -10.0
    told[:, env.problem.layout["modes"]] = part.reshape(len(told), -1)
    return told


class Plan(ShapedSquarePolicy):
    """`shaped_square` with settings of its own for each episode, those of the oracle's search.

    Args:
        logs: (N, 7) logarithms of three periods over 24 s, of share over 0.6, dwell over 0.5 and amplitude over 0.8,
            and a shift of phase.
    """

    def __init__(self, logs: np.ndarray) -> None:
        super().__init__(caution=0.0)
        factors = np.exp(logs)
        self.period = 24.0 * factors[:, :3]  # type: ignore[assignment]
        self.share, self.dwell = 0.6 * factors[:, 3], 0.5 * factors[:, [4]]  # type: ignore[assignment]
        self.amplitude = np.minimum(0.8 * factors[:, [5]], 1.0)  # type: ignore[assignment]
        self._shift = logs[:, [6]]

    def reset(self, mission: Any, seeds: Sequence[int]) -> None:
        """Prepare, each episode with its own phase."""
        super().reset(mission, seeds)
        self._phase = self._phase[0] + 0.25 * self._shift


def search(cell: Cell, seeds: Sequence[int], limit: float) -> Flown:
    """Of each episode the best flight that the cross-entropy method has found; `limit`: of each cost."""
    episodes, rng = len(seeds), np.random.default_rng(0)
    mean, std = np.zeros((episodes, 1, 7)), np.full((episodes, 1, 7), 0.6)
    best: Flown | None = None
    for _ in tqdm(range(_ROUNDS), desc="oracle", unit="round"):
        logs = mean + std * rng.standard_normal((episodes, _POPULATION, 7))
        logs[:, 0] = mean[:, 0]
        flight = flown(cell, Plan(logs.reshape(-1, 7)), np.repeat(seeds, _POPULATION).tolist(), with_true_modes)
        value = _value(flight, limit).reshape(episodes, -1)
        order = np.argsort(value, axis=1)
        chosen = order[:, 0] + _POPULATION * np.arange(episodes)
        here = Flown(*(getattr(flight, name)[chosen] for name in flight.__dataclass_fields__))
        best = here if best is None else _better(best, here, limit)
        elite = np.take_along_axis(logs, order[:, :_ELITE, None], axis=1)
        mean, std = elite.mean(axis=1, keepdims=True), 0.5 * std + 0.5 * elite.std(axis=1, keepdims=True)
    assert best is not None
    return best


def _value(flight: Flown, limit: float) -> np.ndarray:
    """What the search lessens: the expected error, more where a cost is beyond its limit."""
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
