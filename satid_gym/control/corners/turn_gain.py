"""Gain of a turn of the body: what it tells of the inertia, by the covariance of its parameters as observed.

The change v of the rate is measured about each axis with variance R, in units of the rate limit squared, and depends on
theta by H:

    gain = 1/6 ln det(1 + H P H^T / R),  H[i, ij] = v_j sqrt(J_jj / J_ii),  R = T_s sigma^2 (1 / t + 1 / 7 s)

in nats an axis, with P in units of theta's scale and sigma the noise of the gyro's samples, T_s apart, averaged over
the t seconds since the last reversal and some seconds after this one. Source: Chaloner and Verdinelli 1995, Bayesian
experimental design: a review, Statistical Science 10, for the expected gain of a linear measurement.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from satid_gym.control.craft import Craft
from satid_gym.core.observation import observed_std, state_pairs
from satid_gym.estimators.inertia import PRODUCTS, inertia_parameters

HOLD = 7.0  # s


class TurnGain:
    """Gain of turns in N episodes.

    Args:
        seen: parts of the observation by name, (N, size).
        craft: the satellites.
        waited: (N,) s since the last reversal.
    """

    def __init__(self, seen: dict[str, np.ndarray], craft: Craft, waited: np.ndarray) -> None:
        self._count, self._p = seen["uncertainty"].shape
        self._sensitivity = _sensitivity(craft, waited, self._p)
        self._covariance = _covariance(seen)

    def __call__(self, turn: np.ndarray) -> np.ndarray:
        """Nats an axis (N, choices) that changes of the rate (N, choices, 3), over the limit, tell."""
        told = (turn @ self._sensitivity).reshape(self._count, -1, 3, self._p)
        spread = told @ self._covariance[:, None] @ told.swapaxes(2, 3)
        a, b, c, d, e, f = (spread[:, :, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        a, b, c = 1.0 + a, 1.0 + b, 1.0 + c
        det = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
        return np.log(np.maximum(det, 1.0)) / 6.0  # rounding of what is observed may make it less than 1


def _sensitivity(craft: Craft, waited: np.ndarray, p: int) -> np.ndarray:
    """(N, 3, 3 p) [j, (i, k)]: of the rate's change about axis i by that about j times theta_k, over sqrt(R)."""
    moments = inertia_parameters(craft.inertia, "principal")
    noise = craft.noise * (1.0 / waited + 1.0 / HOLD)
    size = np.sqrt(moments[:, None] / moments[:, :, None] / noise[:, None, None])
    by = np.zeros((len(size), 3, 3, p))
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), *PRODUCTS][:p]):
        by[:, j, i, k], by[:, i, j, k] = size[:, i, j], size[:, j, i]
    return by.reshape(len(size), 3, 3 * p)


def _covariance(seen: dict[str, np.ndarray]) -> np.ndarray:
    """(N, p, p) of theta over its scale; without the whole covariance among what is seen, as if not correlated."""
    std = observed_std(seen["uncertainty"])
    count, p = std.shape
    correlation = np.tile(np.eye(p), (count, 1, 1))
    if "state_correlation" in seen:
        others = seen["state_uncertainty"].shape[1]
        places, rows, columns = _correlations_of_theta(p, others)
        value = seen["state_correlation"][:, places]
        correlation[:, rows, columns] = correlation[:, columns, rows] = value
    return correlation * std[:, :, None] * std[:, None]


@cache
def _correlations_of_theta(p: int, others: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where `state_correlation` has those of the inertia parameters, and which two parameters each is of."""
    found = [(i, r - 3, c - 3) for i, (r, c) in enumerate(state_pairs(p, others)) if r >= 3 and c < 3 + p]
    places, rows, columns = np.array(found).T
    return places, rows, columns
