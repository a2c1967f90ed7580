"""True inertia J(t): the inertia law of an episode, its slope and the instants at which it bends."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import axpy_symmetric, load_symmetric, scale_symmetric
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import InertiaMode

_STEP, _DRIFT, _PERIODIC, _TABLE = (
    int(InertiaMode.STEP),
    int(InertiaMode.DRIFT),
    int(InertiaMode.PERIODIC),
    int(InertiaMode.TABLE),
)
_ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inline
def _factor(plant, t):
    """f(t) of J(t) = inertia + f(t) change."""
    if plant.law == _STEP:
        return np.float64(plant.stepped)
    if plant.law == _DRIFT:
        return min(t / plant.law_time, 1.0)
    if plant.law == _PERIODIC:
        return np.sin(2.0 * np.pi * plant.law_frequency * t + plant.law_phase)
    return 0.0


@inline
def _factor_slope(plant, t):
    """df/dt between steps, 1/s."""
    if plant.law == _DRIFT:
        return 1.0 / plant.law_time if t < plant.law_time else 0.0
    if plant.law == _PERIODIC:
        w = 2.0 * np.pi * plant.law_frequency
        return w * np.cos(w * t + plant.law_phase)
    return 0.0


@inline
def _knot_before(plant, t):
    """Index of the last knot of the table at or before t; -1 before the first."""
    low, high = -1, plant.knots
    while high - low > 1:
        middle = (low + high) // 2
        if plant.knot_time[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@inline
def _knot_change(plant, i):
    d = plant.knot_change[i]
    return d[0], d[1], d[2], d[3], d[4], d[5]


@outline
def _table_change(plant, t):
    """D(t) of a table (symmetric): linear between knots, held before the first and after the last."""
    i = _knot_before(plant, t)
    if i < 0:
        return _knot_change(plant, 0)
    if i == plant.knots - 1:
        return _knot_change(plant, i)
    share = (t - plant.knot_time[i]) / (plant.knot_time[i + 1] - plant.knot_time[i])
    rest = axpy_symmetric(-share, _knot_change(plant, i), _knot_change(plant, i))
    return axpy_symmetric(share, _knot_change(plant, i + 1), rest)


@outline
def _table_slope(plant, t):
    """dD/dt of a table just after t (symmetric), kg m^2/s."""
    i = _knot_before(plant, t)
    if i < 0 or i == plant.knots - 1:
        return _ZERO
    change = axpy_symmetric(-1.0, _knot_change(plant, i), _knot_change(plant, i + 1))
    return scale_symmetric(1.0 / (plant.knot_time[i + 1] - plant.knot_time[i]), change)


@inline
def inertia_at(plant, t):
    """True inertia J(t), wheels locked (symmetric)."""
    if plant.law == _TABLE:
        return axpy_symmetric(1.0, _table_change(plant, t), load_symmetric(plant.inertia))
    return axpy_symmetric(_factor(plant, t), load_symmetric(plant.change), load_symmetric(plant.inertia))


@inline
def inertia_slope(plant, t):
    """dJ/dt between steps (symmetric), kg m^2/s."""
    if plant.law == _TABLE:
        return _table_slope(plant, t)
    return scale_symmetric(_factor_slope(plant, t), load_symmetric(plant.change))


@inline
def next_bend(plant, end):
    """First instant after plant.time and not after `end` at which J steps or its slope changes; else `end`."""
    bends = plant.law == _DRIFT and plant.time < plant.law_time
    if bends or (plant.law == _STEP and plant.stepped == 0):
        return min(plant.law_time, end)
    if plant.law == _TABLE:
        following = _knot_before(plant, plant.time) + 1
        if following < plant.knots:
            return min(end, plant.knot_time[following])
    return end


@inline
def take_step(plant):
    """Let J step where the time of its step has come."""
    if plant.law == _STEP and plant.time >= plant.law_time:
        plant.stepped = 1


@inline
def law_turn(plant, duration):
    """Angle by which the phase of a periodic law advances, rad; 0 of others."""
    return duration * 2.0 * np.pi * plant.law_frequency if plant.law == _PERIODIC else 0.0
