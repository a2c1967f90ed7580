"""Changes of the body rate that hardly excite the modes of panels and tanks.

A mode that is excited by an acceleration a and a rate omega of the body swings about

    eta_0 = (omega . D omega / 2 - d . a) / w^2

with an amplitude that its present deflection and rate give. The first term is the pull of the rotation, D the
derivative of the inertia by eta: two rates of 0.05 rad/s bend a panel of 0.08 Hz, along one of the axes and hinged
about the third, by half a degree for as long as they last. With x = eta less that pull, the amplitude is

    A^2 = (x + d . a / w^2)^2 + (deta/dt / w)^2.

So the rate along d changes in a decision as far as it should, but so that A + |d . a| / w^2, the deflection that then
follows about the pull, stays within a share of its limit; where it rings beyond that already, so that the decision
damps it most. w is the filter's estimate less some of its standard deviations, for a mode that is slower bends further.
Modes are spared one after another: where there are several that the same axes excite, only the last is spared for
certain.

Deflections are observed over what a step of the rate by its limit rings of the data sheet's mode. The data sheet, w and
|d|, is what the filter believes when a flight begins. A mode of 10 or more cycles a decision is observed as of 10: it
is taken to be slower than it is, which spares it more than it needs.
"""

from __future__ import annotations

import numpy as np

from satid_gym.control.observed_modes import STEPS, Modes

_LARGE = 1e6  # cost of what does not spare it
_CHOICES = np.linspace(-1.0, 1.0, 41)  # of the largest change
_TINY = 1e-12  # of a length, so that none is divided by 0
_FARTHEST, _HALVINGS = 100.0, 45  # of a bisection, whose place is then known to some 1e-12
_CHANGE_MAX = 2.0 * np.sqrt(3.0)  # change that is ever wanted along a direction, in rate limits: all three reverse


def shaped(
    modes: Modes, held: np.ndarray, wanted: np.ndarray, edge: np.ndarray, share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rates for the next decision, (N, 3) over the limit, as near to the wanted ones as spares the modes.

    Args:
        modes: of N episodes.
        held: (N, 3) rates that are commanded now.
        wanted: (N, 3) rates.
        edge: (N, 3) or (3,) largest rates.
        share: of the limits of deflection, that of `modes`.

    Returns:
        The rates, and (N, 3) the largest change about each axis that spares the modes when they are at rest.
    """
    change, low, high = wanted - held, -edge - held, edge - held
    most, pulled = np.full(change.shape, np.inf), modes.pulled(wanted)
    for m in range(modes.limit.shape[1]):
        direction = modes.direction[:, m]
        given, largest = _spared(modes, m, (direction * change).sum(axis=1), pulled[:, m], share)
        change = _turned_to(given, direction, change, low, high)
        most = np.minimum(most, largest[:, None] / np.maximum(np.abs(direction), _TINY))
    return held + np.clip(change, low, high), most


def bearable(modes: Modes, rates: np.ndarray) -> np.ndarray:
    """Rates (N, K, 3) over the limit, made smaller where their rotation pulls a mode beyond its share of the limit."""
    pulled = np.stack([modes.pulled(rates[:, k]) for k in range(rates.shape[1])], axis=1)
    room = modes.limit[:, None] / np.maximum(np.abs(pulled), _TINY)
    return rates * np.sqrt(np.minimum(room, 1.0)).min(axis=2, initial=1.0)[:, :, None]


def _spared(
    modes: Modes, m: int, wanted: np.ndarray, pulled: np.ndarray, share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Change of the rate along d of mode m, (N,) in rate limits, nearest to the wanted one that spares the mode, and
    the largest that does when the mode is at rest."""
    bent, limit = np.maximum(modes.bent[:, m] / STEPS, _TINY), modes.limit[:, m]
    most, reach = np.minimum(0.5 * limit / bent, _CHANGE_MAX), np.minimum(limit / share / bent, _CHANGE_MAX)
    wide = reach[:, None] * _CHOICES  # for what rings beyond its share
    choices = np.column_stack([2.0 * most[:, None] * _CHOICES, wide, np.clip(wanted, -reach, reach)])
    centre = -choices * bent[:, None]
    state = (modes.swing[:, m, 0] - pulled + 1j * modes.swing[:, m, 1])[:, None]
    spared = np.abs(state - centre) + np.abs(centre) <= (limit - np.abs(pulled))[:, None]
    left = np.abs(centre + (state - centre) * np.exp(-1j * modes.turned[:, m])[:, None])  # at rest after the decision
    cost = np.where(spared, np.abs(choices - wanted[:, None]), _LARGE + left)
    best = np.argmin(cost, axis=1)
    return choices[np.arange(len(best)), best], most


def _turned_to(
    given: np.ndarray, direction: np.ndarray, change: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Nearest to a change (N, 3) of those within bounds that are `given` (N,) along a direction, or come nearest to it:
    the change plus a multiple of the direction, cut to the bounds, which grows along the direction with the multiple.
    """
    least = np.full((len(change), 1), -_FARTHEST)
    most = -least
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + most)
        found = (direction * np.clip(change + middle * direction, low, high)).sum(axis=1, keepdims=True)
        least, most = np.where(found < given[:, None], middle, least), np.where(found < given[:, None], most, middle)
    return np.clip(change + most * direction, low, high)
