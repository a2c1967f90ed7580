"""Coordinates in which every inertia is physical.

A body's inertia J and the second moment S of its mass, S = sum m r r^T, determine each other:

    J = tr(S) 1 - S,   S = tr(J) / 2 1 - J

J is positive definite with principal moments that meet the triangle inequalities exactly where S is positive
semidefinite, so S = C C^T with any lower triangular C is physical.
Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018; Rucker, Wensing, IEEE RA-L 7(2), 2022 (log-Cholesky).
"""

from __future__ import annotations

import numpy as np
import scipy.optimize

from satid_gym.estimators.inertia import PARAMETER_COUNT, PRODUCTS, Parameters, inertia_parameters, inertia_tensors
from satid_gym.rigid_body import least_second_moment, second_moment

_ENTRIES = [(0, 0), (1, 1), (2, 2), *((j, i) for i, j in PRODUCTS)]  # of C: diagonal, then below it
_SPREAD_MIN = 1e-6  # of tr(S): a start on the boundary would never leave it


def is_physical(theta: np.ndarray) -> bool:
    """Whether some body of positive extent in every direction has the inertia theta (p,)."""
    return least_second_moment(inertia_tensors(theta)) > 0.0


def to_factor(theta: np.ndarray) -> np.ndarray:
    """Entries (p,) of C for theta (p,): a physical inertia's own, otherwise those of one near to it."""
    moment = second_moment(inertia_tensors(theta))
    values, vectors = np.linalg.eigh(moment)
    least = _SPREAD_MIN * np.abs(values).sum()
    if values[0] < least:
        moment = (vectors * np.maximum(values, least)) @ vectors.T
    factor = np.linalg.cholesky(moment)
    return np.array([factor[entry] for entry in _ENTRIES[: len(theta)]])


def from_factor(entries: np.ndarray) -> np.ndarray:
    """theta (p,) of the entries (p,) of C."""
    factor = _factor(entries)
    return _theta(factor @ factor.T, len(entries))


def factor_jacobian(entries: np.ndarray) -> np.ndarray:
    """d theta / d entries (p, p)."""
    factor = _factor(entries)
    columns = []
    for unit in np.eye(len(entries)):
        half = _factor(unit) @ factor.T
        columns.append(_theta(half + half.T, len(entries)))
    return np.column_stack(columns)


def factor_bounds(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the entries (p,): a diagonal that is not negative makes C unique."""
    low = np.full(count, -np.inf)
    low[:3] = 0.0
    return low, np.full(count, np.inf)


def nearest_physical(theta: np.ndarray, information: np.ndarray) -> np.ndarray:
    """The physical inertia nearest to theta (p,) in the metric of its information (p, p).

    Of a linear least-squares estimate with that information it is the minimum under the constraint.
    """
    if is_physical(theta):
        return theta
    root = np.linalg.cholesky(information).T
    result = scipy.optimize.least_squares(
        lambda c: root @ (from_factor(c) - theta),
        to_factor(theta),
        jac=lambda c: root @ factor_jacobian(c),
        bounds=factor_bounds(len(theta)),
        x_scale="jac",
    )
    return from_factor(result.x)


def _factor(entries: np.ndarray) -> np.ndarray:
    factor = np.zeros((3, 3))
    for value, entry in zip(entries, _ENTRIES, strict=False):
        factor[entry] = value
    return factor


def _theta(moment: np.ndarray, count: int) -> np.ndarray:
    parameters: Parameters = "principal" if count == PARAMETER_COUNT["principal"] else "full"
    return inertia_parameters(np.trace(moment) * np.eye(3) - moment, parameters)
