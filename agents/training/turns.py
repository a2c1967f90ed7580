"""Turns of the body frame by right angles, under which what a satellite should do turns with it.

Body axes are names alone: of the frames that share their directions, 24 of one handedness, none is special, and limits
are by axis. What is observed in one, in the form "body", is observed in another with other places and signs, and so are
the answers to it. A fit to all of them has 24 times as many examples, and a network that hardly minds the frame.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from satid_gym.estimators.inertia import PRODUCTS

_VECTORS = ("rate", "wheel_momentum", "disturbance", "coast_rate_change", "command")
_BY_AXIS = ("control_authority", "momentum_fraction")
_SCALARS = ("fastest_wheel", "time_left", "nis", "inertia_walk")
_PARTS = ("inertia", "uncertainty", "correlation", "state_uncertainty", "state_correlation")


@dataclass(frozen=True, eq=False, kw_only=True)
class Turn:
    """A turn of the body frame: what stands where, and with which sign.

    Attributes:
        places: (size,) of the numbers of an observation that become its numbers.
        signs: (size,) of these, float32.
        axes: (3,) the same of the axes.
        axis_signs: (3,) of these, float32.
    """

    places: np.ndarray
    signs: np.ndarray
    axes: np.ndarray
    axis_signs: np.ndarray

    def observed(self, observation: np.ndarray) -> np.ndarray:
        """Observations (N, size) in the frame that has been turned."""
        return observation[:, self.places] * self.signs

    def by_axis(self, values: np.ndarray) -> np.ndarray:
        """Numbers (N, 3) that are odd in the axes, as commands are."""
        return values[:, self.axes] * self.axis_signs


def turns(layout: dict[str, slice]) -> list[Turn]:
    """All 24 turns of observations in a layout of the form "body", of the full tensor; the first turns nothing.

    Raises:
        ValueError: the layout has parts whose turns are not known, as those of modes are not, or three moments.
    """
    size = {name: place.stop - place.start for name, place in layout.items()}
    unknown = [n for n in size if n not in (*_VECTORS, *_BY_AXIS, *_SCALARS, *_PARTS) and size[n] > 0]
    if (
        unknown
        or size.get("state_uncertainty", 0) not in (0, 6)
        or size["inertia"] != 6
        or "wheel_momentum" not in size
    ):
        raise ValueError(
            'observations are turned in the form "body", of the full tensor without modes, attitude or calibration: '
            f"got {size}"
        )
    found = []
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            rotation = np.zeros((3, 3))
            rotation[range(3), axes] = signs
            if np.linalg.det(rotation) > 0.0:
                found.append(_turn(layout, np.array(axes), np.array(signs)))
    return found


def _turn(layout: dict[str, slice], axes: np.ndarray, axis_signs: np.ndarray) -> Turn:
    pairs = [(0, 0), (1, 1), (2, 2), *PRODUCTS]
    turned = [tuple(sorted((axes[i], axes[j]))) for i, j in pairs]
    parameters = np.array([pairs.index(pair) for pair in turned])
    parameter_signs = np.array([axis_signs[i] * axis_signs[j] for i, j in pairs])
    states = np.concatenate([axes, 3 + parameters, 9 + axes])  # momentum, parameters, torque
    state_signs = np.concatenate([axis_signs, parameter_signs, axis_signs])
    end = max(place.stop for place in layout.values())
    places, signs = np.arange(end), np.ones(end, np.float32)
    for name, place in layout.items():
        if name in (*_VECTORS, *_BY_AXIS):
            places[place] = place.start + axes
            signs[place] = axis_signs if name in _VECTORS else 1.0
        elif name in ("inertia", "uncertainty"):
            places[place] = place.start + parameters
            signs[place] = parameter_signs if name == "inertia" else 1.0
        elif name == "correlation":
            places[place] = place.start + (6 * axes[:, None] + parameters).ravel()
            signs[place] = np.outer(axis_signs, parameter_signs).ravel()
        elif name == "state_uncertainty":
            places[place] = place.start + np.concatenate([axes, 3 + axes])
        elif name == "state_correlation":
            kept = [(r, c) for r in range(12) for c in range(r + 1, 12) if r >= 3 or c < 3 or c >= 9]
            places[place] = place.start + np.array([kept.index(tuple(sorted((states[r], states[c])))) for r, c in kept])
            signs[place] = [state_signs[r] * state_signs[c] for r, c in kept]
    return Turn(places=places, signs=signs, axes=axes, axis_signs=axis_signs.astype(np.float32))
