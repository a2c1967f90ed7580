"""Mode that is nearest to its limit, of which features of corners tell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from satid_gym.control.observed_modes import Modes

SLOWEST = 1e-3  # w T


class NearestMode(NamedTuple):
    """Mode nearest to its limit, of N episodes; zeros without modes.

    Attributes:
        number: (N,) which it is.
        direction: (N, 3) unit vector of d.
        deflection, speed: (N, 1) eta and deta/dt / w, over the limit.
        frequency: (N, 1) ln(w T).
    """

    number: np.ndarray
    direction: np.ndarray
    deflection: np.ndarray
    speed: np.ndarray
    frequency: np.ndarray

    @classmethod
    def of(cls, modes: Modes) -> NearestMode:
        """The nearest of each episode."""
        if modes.limit.shape[1] == 0:
            none = np.zeros((len(modes.limit), 1))
            return cls(np.zeros(len(none), int), np.zeros((len(none), 3)), none, none, none)
        over = modes.swing / modes.limit[:, :, None]
        row, nearest = np.arange(len(over)), np.argmax(np.hypot(over[:, :, 0], over[:, :, 1]), axis=1)
        deflection, speed = over[row, nearest].T[:, :, None]
        frequency = np.log(np.maximum(modes.turned[row, nearest], SLOWEST))[:, None]
        return cls(nearest, modes.direction[row, nearest], deflection, speed, frequency)
