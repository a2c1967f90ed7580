"""Local search of plans that are rehearsed, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from satid_gym.control.planning.rehearsal import begin, copy_row, fly
from satid_gym.core.jit import inline, kernel
from satid_gym.core.random import uniform

_LEVELS = 3  # of a rate, over its limit: a third, two, and all of it
_SPAN = 6.0  # decisions that a change lasts, mean
_STOP = (6.0, 18.0)  # decisions
_SWING = 12.0  # decisions between two stops, at most


class Search(NamedTuple):
    """Settings of a search.

    Attributes:
        edits: changes that are tried.
        tail: how many decisions at the error of the last one the loss of a plan counts in addition to its own.
        caution: standard deviations, see `mode_doubles`.
    """

    edits: int
    tail: float
    caution: float


@inline
def _move(plan, start, span, stops):
    """Move what follows a decision to later, by as many decisions; before it nothing turns, or what did goes on."""
    for t in range(plan.shape[0] - 1, start - 1, -1):
        for i in range(3):
            plan[t, i] = plan[max(t - span, start), i]
            if stops and t < start + span:
                plan[t, i] = 0.0


@inline
def _hold(plan, start, span, level, axis, stream):
    """Give all axes, or one where `axis` is not negative, a rate of this size for a while, of sides drawn."""
    for i in range(3):
        side = level if uniform(stream) < 0.5 else -level
        if axis < 0 or i == axis:
            for t in range(start, min(start + span, plan.shape[0])):
                plan[t, i] = side


@inline
def _stop(plan, start, stream):
    """Stop at a decision, and move what follows to after it; returns when it goes on."""
    span = np.int64(_STOP[0] + (_STOP[1] - _STOP[0]) * uniform(stream))
    _move(plan, start, span, True)
    return start + span


@inline
def _edit(plan, stars, stream):
    """Change a plan (H, 3): what follows sooner or later, one stop or two, or other rates for a while.

    Where attitudes are read from `stars`, a first stop may tell nothing before a second has followed.
    """
    ahead = plan.shape[0]
    start, kind = np.int64(ahead * uniform(stream)), uniform(stream)
    span = 1 - np.int64(_SPAN * np.log(uniform(stream)))
    if kind < 0.15:
        for t in range(start, ahead):
            plan[t] = plan[min(t + span, ahead - 1)]
    elif kind < 0.3:
        _move(plan, start, span, False)
    elif kind < 0.4:
        again = _stop(plan, start, stream)
        if stars and uniform(stream) < 0.5:
            _stop(plan, min(again + 1 + np.int64(_SWING * uniform(stream)), ahead), stream)
    elif kind < 0.43:
        plan[:] = 0.0
    elif kind < 0.5:
        _hold(plan, start, span, 0.0, -1, stream)
    else:
        level = 1.0 if uniform(stream) < 0.5 else (1.0 + np.int64(_LEVELS * uniform(stream))) / _LEVELS
        axis = np.int64(3.0 * uniform(stream)) if kind > 0.85 else -1
        _hold(plan, start, span, level, axis, stream)


@kernel
def improve_rehearsed(flights, plans, proposals, shares, trails, scratch, streams, search):
    """Reduce the loss that plans (N, H, 3), rates over those allowed, promise; a change is kept if it loses less.

    Proposals are tried, and then one edit after another.

    Args:
        flights: `Flights`; since when their trackers track is written.
        plans: in [-1, 1], written.
        proposals: (N, K, H, 3) other plans.
        shares: (3,) of the rate limit that is allowed about each axis.
        trails: two `Trail` of H + 1 rows.
        scratch: `Scratch`.
        streams: (N, 4) of random numbers.
        search: `Search`.
    """
    trail, other = trails
    ahead = plans.shape[1]
    for i in range(plans.shape[0]):
        plan, trial = plans[i], plans[i].copy()
        begin(trail, 0, flights, i, search.caution)
        fly(trail, plan * shares, 0, np.inf, scratch)
        best = trail.losses[ahead] + search.tail * (trail.losses[ahead] - trail.losses[ahead - 1])
        for k in range(proposals.shape[1] + search.edits):
            if k < proposals.shape[1]:
                trial[:] = proposals[i, k]
            else:
                trial[:] = plan
                _edit(trial, trail.beliefs[0].attitude.boresight.shape[0] > 0, streams[i])
            first = 0  # until then the trial is the plan
            while first < ahead and (trial[first] == plan[first]).all():
                first += 1
            if first == ahead:
                continue
            copy_row(trail, other, first)
            fly(other, trial * shares, first, best, scratch)
            loss = other.losses[ahead]
            if loss < best:
                loss += search.tail * (loss - other.losses[ahead - 1])
            if loss < best:
                best = loss
                plan[:] = trial
                for d in range(first + 1, ahead + 1):
                    copy_row(other, trail, d)
