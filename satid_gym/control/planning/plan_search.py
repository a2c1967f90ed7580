"""Local search of rate plans, compiled."""

from __future__ import annotations

import numpy as np

from satid_gym.control.planning.forecast import fly_plan
from satid_gym.core.jit import inline, kernel
from satid_gym.core.random import uniform

_SIZES = 4.0  # of rates
_RESIZED = 0.4  # share of the edits that begin with a change of size


@inline
def _resize(plan, ahead, stream):
    """Change how large the rates of a plan are, all axes' or one's, for a while or from some decision on."""
    k, size = np.int64(6.0 * uniform(stream)), np.int64(1.0 + _SIZES * uniform(stream)) / _SIZES
    start, span = np.int64(ahead * uniform(stream)), 1 - np.int64(6.0 * np.log(uniform(stream)))
    end = ahead if uniform(stream) < 0.3 else min(start + span, ahead)
    for t in range(start, end):
        for i in range(3):
            if k >= 3 or i == k:
                plan[t, i] = size if plan[t, i] > 0.0 else -size


@inline
def _edit(plan, ahead, stream):
    """Change one axis of a plan: all reversals or one, sooner or later; or reverse it for a while or from then on."""
    k = np.int64(3.0 * uniform(stream))
    kind, start = uniform(stream), np.int64(ahead * uniform(stream))
    all_sooner, all_later, one_sooner, one_later = kind < 0.1, kind < 0.2, 0.2 <= kind < 0.4, 0.4 <= kind < 0.6
    short = one_sooner or one_later or uniform(stream) < 0.6
    span = 1 - np.int64((2.0 if short else 12.0) * np.log(uniform(stream)))
    if all_sooner:
        for t in range(ahead):
            plan[t, k] = plan[min(t + span, ahead - 1), k]
        return
    if all_later:
        for t in range(ahead - 1, -1, -1):
            plan[t, k] = plan[max(t - span, 0), k]
        return
    if one_sooner or one_later:
        for _ in range(ahead):  # on to a reversal, over the end
            if start > 0 and plan[start, k] != plan[start - 1, k]:
                break
            start = (start + 1) % ahead
    if one_sooner:
        start -= span
    end = ahead if kind > 0.85 else min(start + span, ahead)
    for t in range(max(start, 0), end):
        plan[t, k] = -plan[t, k]


@kernel
def improve_many(start, trail, other, scratch, plans, streams, edits, world):
    """See `Planner.improve`; plans (N, H, 3), streams (N, 4), and two trails of as many decisions as are looked at."""
    ahead, trial = trail.errors.shape[0] - 1, np.empty(plans.shape[1:])
    resizes = world.avoided[1] > world.avoided[0]  # else the largest rates tell most
    trail.errors[0] = 0.0
    for i in range(start.beliefs.shape[0]):
        plan, limits = plans[i], (start.caps[i], start.null_speeds[i])
        trail.beliefs[0], trail.rates[0] = start.beliefs[i], start.rates[i]
        fly_plan(trail, scratch, limits, plan, 0, world, False, np.inf)
        for _ in range(edits):
            trial[:] = plan
            if resizes and uniform(streams[i]) < _RESIZED:
                _resize(trial, ahead, streams[i])
            else:
                _edit(trial, ahead, streams[i])
            if uniform(streams[i]) < 0.5:
                _edit(trial, ahead, streams[i])
            first = 0  # until then the trial is the plan
            while first < ahead and (trial[first] == plan[first]).all():
                first += 1
            if first == ahead:
                continue
            other.beliefs[first], other.rates[first] = trail.beliefs[first], trail.rates[first]
            other.errors[first] = trail.errors[first]
            fly_plan(other, scratch, limits, trial, first, world, False, trail.errors[ahead])
            if other.errors[ahead] < trail.errors[ahead]:
                plan[:] = trial
                for d in range(first + 1, ahead + 1):
                    trail.beliefs[d], trail.rates[d] = other.beliefs[d], other.rates[d]
                    trail.errors[d] = other.errors[d]
