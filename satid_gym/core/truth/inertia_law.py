"""True inertia J(t): the inertia law of an episode, its slope and the instants at which it bends."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import axpy_symmetric, load_symmetric, scale_symmetric
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import InertiaMode

_STATIC, _STEP, _DRIFT, _PERIODIC, _TABLE = (
    int(InertiaMode.STATIC),
    int(InertiaMode.STEP),
    int(InertiaMode.DRIFT),
    int(InertiaMode.PERIODIC),
    int(InertiaMode.TABLE),
)
_DEPLOYMENT, _FUEL, _RELEASE = int(InertiaMode.DEPLOYMENT), int(InertiaMode.FUEL), int(InertiaMode.RELEASE)
_ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inline
def steps(plant):
    """Whether J steps at law_time."""
    return plant.law == _STEP or plant.law == _RELEASE


@inline
def varies(plant):
    """Whether J moves between steps."""
    return plant.law != _STATIC and not steps(plant)


@inline
def _drifts(plant):
    return plant.law == _DRIFT or plant.law == _FUEL


@inline
def _deployed(plant, t):
    """Time since a deployment began over its duration, within 0 and 1."""
    return min(max((t - plant.law_time) / plant.law_duration, 0.0), 1.0)


@inline
def _factor(plant, t):
    """f(t) of J(t) = inertia + f(t) change."""
    if steps(plant):
        return np.float64(plant.stepped)
    if _drifts(plant):
        return min(t / plant.law_time, 1.0)
    if plant.law == _DEPLOYMENT:
        s = _deployed(plant, t)
        return s * s * (3.0 - 2.0 * s)
    if plant.law == _PERIODIC:
        return np.sin(2.0 * np.pi * plant.law_frequency * t + plant.law_phase)
    return 0.0


@inline
def _factor_slope(plant, t):
    """df/dt between steps, 1/s."""
    if _drifts(plant):
        return 1.0 / plant.law_time if t < plant.law_time else 0.0
    if plant.law == _DEPLOYMENT:
        s = _deployed(plant, t)
        return 6.0 * s * (1.0 - s) / plant.law_duration
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
    bends = (_drifts(plant) or plant.law == _DEPLOYMENT) and plant.time < plant.law_time
    if bends or (steps(plant) and plant.stepped == 0):
        return min(plant.law_time, end)
    if plant.law == _DEPLOYMENT and plant.time < plant.law_time + plant.law_duration:
        return min(plant.law_time + plant.law_duration, end)
    if plant.law == _TABLE:
        following = _knot_before(plant, plant.time) + 1
        if following < plant.knots:
            return min(end, plant.knot_time[following])
    return end


@inline
def is_released(plant):
    """Whether what leaves in a step takes its angular momentum along."""
    return plant.law == _RELEASE


@inline
def moves_mass(plant):
    """Whether somebody commands the change of J, at law_time."""
    return plant.law == _DEPLOYMENT or plant.law == _RELEASE


@inline
def announced_share(plant, dt):
    """Share of the commanded change that came in the dt seconds until plant.time: of its duration, or all at once."""
    if plant.law == _DEPLOYMENT:
        return _deployed(plant, plant.time) - _deployed(plant, plant.time - dt)
    since = plant.time - dt * (1.0 + 1e-9)  # so that rounding does not lose it
    return 1.0 if since < plant.law_time <= plant.time else 0.0


@inline
def law_turn(plant, duration):
    """Angle by which the phase of a periodic law advances, rad; 0 of others."""
    return duration * 2.0 * np.pi * plant.law_frequency if plant.law == _PERIODIC else 0.0
