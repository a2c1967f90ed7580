"""Changes of the body rate that hardly excite the modes of panels and tanks.

A mode that is excited by an acceleration a and a rate omega of the body swings about

    eta_0 = (omega . D omega / 2 - d . a) / w^2

with an amplitude that its present deflection and rate give. The first term is the pull of the rotation, D the
derivative of the inertia by eta: rates of 0.05 rad/s about two axes bend a panel of 0.085 Hz, which lies along one of
them and is hinged about the third, by half a degree for as long as they last. With x = eta less that pull, the
amplitude is

    A^2 = (x + d . a / w^2)^2 + (deta/dt / w)^2.

So the rate along d changes in a decision as far as it should, but so that the pull, A and |d . a| / w^2 together, the
largest deflection that can follow, stay within a share of its limit; where it rings beyond that already, so that the
decision damps it most. The pull is that of the wanted rates, which the decision may not reach; that it grows with the
deflection itself is left out. w is the filter's estimate less some of its standard deviations, for a mode that is
slower bends further. Modes are spared one after another: where there are several that the same axes excite, only the
last is spared for certain.

Deflections are observed over what a step of the rate by its limit rings of the data sheet's mode. The data sheet, w and
|d|, is what the filter believes when a flight begins. A mode of 10 or more cycles a decision is observed as of 10: it
is taken to be slower than it is, which spares it more than it needs.
"""

from __future__ import annotations

import numpy as np

from satid_gym.control.observed_modes import TINY, Modes, pulled_by
from satid_gym.core.algebra import dot, load
from satid_gym.core.jit import inline, kernel, outline

_SLACK = 1.0 + 1e-9  # so that rounding does not refuse the change that bends a mode at rest to exactly its share
_LARGE = 1e6  # cost of what does not spare it
_CHOICES = 20  # to either side, of the largest change
_FARTHEST, _HALVINGS = 100.0, 45  # of a bisection, whose place is then known to some 1e-12
_CHANGE_MAX = 2.0 * np.sqrt(3.0)  # change that is ever wanted along a direction, in rate limits: all three reverse


def shaped(
    modes: Modes, held: np.ndarray, wanted: np.ndarray, edge: np.ndarray, share: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Rates for the next decision, over the limit, as near to the wanted ones as spares the modes.

    Args:
        modes: of N episodes, with their whole limits.
        held: (N, 3) rates that are commanded now.
        wanted: (N, K, 3) rates, K choices.
        edge: (N, 3) largest rates.
        share: of the limits that is used, (N,) or the same for all.

    Returns:
        The rates (N, K, 3), and (N, 3) the largest change about each axis that spares the modes when they are at rest.
    """
    rates, most = np.empty(wanted.shape), np.full(held.shape, np.inf)
    shares = np.full(len(held), 1.0) * share
    shape_many(modes, held, np.array(wanted, order="C"), edge, shares, rates, most)  # one kernel for all
    return rates, most


def bearable(modes: Modes, rates: np.ndarray, share: float) -> np.ndarray:
    """Rates (N, K, 3) over the limit, made smaller where their rotation pulls a mode beyond a share of its limit."""
    smaller = np.empty(rates.shape)
    bear_many(modes, np.array(rates, order="C"), np.full(len(rates), share), smaller)
    return smaller


@kernel
def bear_many(modes, wanted, share, rates):
    """See `bearable`; a share (N,)."""
    for i in range(wanted.shape[0]):
        for c in range(wanted.shape[1]):
            room = 1.0
            for m in range(modes.limit.shape[1]):
                pulled = abs(pulled_by(modes, i, m, load(wanted[i, c])))
                room = min(room, share[i] * modes.limit[i, m] / max(pulled, TINY))
            for k in range(3):
                rates[i, c, k] = wanted[i, c, k] * np.sqrt(room)


@kernel
def shape_many(modes, held, wanted, edge, share, rates, most):
    """See `shaped`."""
    change, low, high = np.empty(3), np.empty(3), np.empty(3)
    for i in range(wanted.shape[0]):
        for k in range(3):
            low[k], high[k] = -edge[i, k] - held[i, k], edge[i, k] - held[i, k]
        for m in range(modes.limit.shape[1]):
            largest = _largest_at_rest(modes, i, m, share[i])
            for k in range(3):
                most[i, k] = min(most[i, k], largest / max(abs(modes.direction[i, m, k]), TINY))
        for c in range(wanted.shape[1]):
            for k in range(3):
                change[k] = wanted[i, c, k] - held[i, k]
            for m in range(modes.limit.shape[1]):
                given = _spared(modes, i, m, change, wanted[i, c], share[i])
                _turn_to(given, modes.direction[i, m], change, low, high)
            for k in range(3):
                rates[i, c, k] = held[i, k] + min(max(change[k], low[k]), high[k])


@inline
def _largest_at_rest(modes, i, m, share):
    """Largest change of the rate along d, rate limits, that spares mode m of episode i when it is at rest."""
    return min(0.5 * share * modes.limit[i, m] / max(modes.bent[i, m], TINY), _CHANGE_MAX)


@outline
def _spared(modes, i, m, change, rate, share):
    """Change of the rate along d, rate limits, nearest to that of a wanted change (3,) to a rate (3,), that spares mode
    m of episode i."""
    bent, limit, turned = max(modes.bent[i, m], TINY), modes.limit[i, m], modes.turned[i, m]
    wanted, pulled = dot(load(modes.direction[i, m]), load(change)), pulled_by(modes, i, m, load(rate))
    most, reach = _largest_at_rest(modes, i, m, share), min(limit / bent, _CHANGE_MAX)
    x, y, room = modes.swing[i, m, 0] - pulled, modes.swing[i, m, 1], _SLACK * share * limit - abs(pulled)
    cosine, sine = np.cos(turned), np.sin(turned)
    best, least = 0.0, np.inf
    for n in range(4 * _CHOICES + 3):  # of what it bears at rest, then of all, then what is wanted
        if n <= 2 * _CHOICES:
            choice = 2.0 * most * (n - _CHOICES) / _CHOICES
        elif n <= 4 * _CHOICES + 1:
            choice = reach * (n - 3 * _CHOICES - 1) / _CHOICES
        else:
            choice = min(max(wanted, -reach), reach)
        centre = -choice * bent
        off = x - centre
        if np.sqrt(off * off + y * y) + abs(centre) <= room:
            cost = abs(choice - wanted)
        else:  # by the amplitude at rest after the decision
            cost = _LARGE + np.hypot(centre + off * cosine + y * sine, y * cosine - off * sine)
        if cost < least:
            best, least = choice, cost
    return best


@outline
def _turn_to(given, direction, change, low, high):
    """Move a change (3,) to the nearest within bounds that is `given` along a direction, or comes nearest to it: the
    change plus a multiple of the direction, cut to the bounds, which grows along the direction with the multiple."""
    least, most = -_FARTHEST, _FARTHEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + most)
        found = 0.0
        for k in range(3):
            found += direction[k] * min(max(change[k] + middle * direction[k], low[k]), high[k])
        if found < given:
            least = middle
        else:
            most = middle
    for k in range(3):
        change[k] = min(max(change[k] + most * direction[k], low[k]), high[k])
