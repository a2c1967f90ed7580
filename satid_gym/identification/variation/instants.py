"""Instant of a step: how well the readings near it agree with each possible instant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from satid_gym.identification.fit import BISQUARE, residual_of
from satid_gym.identification.rows import Window
from satid_gym.telemetry import Log

_SIDE = 0.7  # of a window, of readings on either side
_TRIED = 20  # instants at once
_TURNS = 4
_NEAR = 12.0  # twice the log-likelihood below the largest, at which instants are tried more closely
_KEPT = 22.5  # twice the log-likelihood that six more unknowns gain in one of a thousand


@dataclass(frozen=True, eq=False, kw_only=True)
class Instant:
    """Mean and standard deviation, s of the log's clock, and whether the momentum jumped with the inertia."""

    time: float
    std: float
    jumped: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Surroundings:
    """Readings and estimates near a step.

    Attributes:
        log: of the flight.
        build: windows of a part of the log, with breaks at instants.
        before: (6,) theta before the step, kg m^2.
        after: (6,) and after it.
        common: (m,) bias, torque and delays.
        sigma: (3,) N m s, noise by body axis.
        jitter: s, the noise of stamps.
        scale: of squared errors, c.
    """

    log: Log
    build: Callable[[Log, list[float]], list[Window]]
    before: np.ndarray
    after: np.ndarray
    common: np.ndarray
    sigma: np.ndarray
    jitter: float
    scale: float

    def loss(self, at: float, jumped: bool) -> float:
        """Bisquare loss over c of a step at an instant, about twice the negative log-likelihood."""
        total, count = 0.0, 0
        for row in self.build(self.log, [at] if jumped else []):
            std = np.sqrt(self.sigma**2 + (self.jitter * row.motion) ** 2)
            theta = np.where((row.time < at)[:, None], self.before, self.after)
            square = ((residual_of(row, std, np.ones(len(row)), theta, self.common) / std) ** 2).sum(axis=1)
            total += float((1.0 - np.clip(1.0 - square / BISQUARE**2, 0.0, None) ** 3).sum()) * BISQUARE**2 / 3.0
            count += len(row)
        return total / max(count, 1) * len(self.log) / self.scale  # a side without a window has no rows


def step_instant(around: Surroundings, low: float, high: float, window: float) -> Instant:
    """Instant of a step between low and high, s, from its likelihood over the middles between readings.

    The momentum before and after it are unknowns of their own where one momentum contradicts the readings.
    """
    time = around.log.time
    reach = (time >= low - _SIDE * window) & (time <= high + _SIDE * window)
    near = replace(around, log=around.log.rows(reach))
    middles = 0.5 * (near.log.time[1:] + near.log.time[:-1])
    middles = middles[(middles > low) & (middles < high)]
    if len(middles) == 0:
        return Instant(time=0.5 * (low + high), std=(high - low) / np.sqrt(12.0), jumped=True)
    kept, jumped = _likelihood(near, middles, False), _likelihood(near, middles, True)
    return jumped[1] if kept[0] - jumped[0] > _KEPT else kept[1]


def _likelihood(near: Surroundings, middles: np.ndarray, jumped: bool) -> tuple[float, Instant]:
    """The least loss, and the instant."""
    found: dict[int, float] = {}
    first, last = 0, len(middles) - 1
    for _ in range(_TURNS):
        for k in np.unique(np.linspace(first, last, _TRIED).round().astype(int)):
            if k not in found:
                found[int(k)] = near.loss(float(middles[k]), jumped)
        places = np.array(sorted(found))
        losses = np.array([found[k] for k in places])
        good = np.flatnonzero(losses < losses.min() + _NEAR)
        first, last = places[max(good[0] - 1, 0)], places[min(good[-1] + 1, len(places) - 1)]
    at = middles[places]
    weight = np.exp(-0.5 * (losses - losses.min())) * (np.gradient(at) if len(at) > 1 else 1.0)
    weight = weight / weight.sum()
    mean = float(weight @ at)
    std = float(np.sqrt(weight @ (at - mean) ** 2 + near.log.interval**2 / 12.0))
    return float(losses.min()), Instant(time=mean, std=std, jumped=jumped)
