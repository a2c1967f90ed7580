"""Judgement of a fit: identified parameters, whiteness of the residuals, and excess of scatter over the claim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.estimators.batch.regression import SIGNAL_MIN, STD_MAX
from satid_gym.identification.fit import Fit

WHITE_MAX = 3.0  # standard deviations of the autocorrelation that white residuals stay within
_JACKKNIFE_MIN = 4  # flights from which on their scatter says something about each parameter


@dataclass(frozen=True, kw_only=True)
class Whiteness:
    """Autocorrelation of the residuals from one reading to the next, and its distance from 0 in its own std."""

    autocorrelation: float
    distance: float

    @property
    def white(self) -> bool:
        """Whether it is within three standard deviations of 0."""
        return abs(self.distance) <= WHITE_MAX


def whiteness(fit: Fit) -> Whiteness:
    """Whiteness of residuals in units of their noise, each instant with its weight, within windows."""
    pairs, squares, terms = 0.0, 0.0, 0.0
    for normal, weight in zip(fit.normal, fit.weights, strict=True):
        rows = normal * np.sqrt(weight)[:, None]
        products = rows[1:] * rows[:-1]
        pairs, terms, squares = pairs + products.sum(), terms + (products**2).sum(), squares + (rows**2).sum()
    if squares == 0.0 or terms == 0.0:
        return Whiteness(autocorrelation=0.0, distance=0.0)
    return Whiteness(autocorrelation=float(pairs / squares), distance=float(pairs / np.sqrt(terms)))


def scatter(fit: Fit) -> tuple[float, float]:
    """Variance of the scores between windows, and between flights, relative to white noise of that size.

    The ratio of the jackknife's sandwich to the formal covariance as one number, the mean over the directions of theta
    in the metric of the formal covariance. NaN where there is one window, or one flight, alone.
    Source: White, Econometrica 50(1), 1982; Bell and McCaffrey, Survey Methodology 28(2), 2002 (few clusters).
    """
    windows = np.concatenate([share.scores for share in fit.flights])
    expected = np.concatenate([share.expected for share in fit.flights])
    flights = np.array([share.scores.sum(axis=0) for share in fit.flights])
    together = np.array([share.expected.sum(axis=0) for share in fit.flights])
    return _ratio(windows, expected), _ratio(flights, together)


def _ratio(scores: np.ndarray, expected: np.ndarray) -> float:
    """Of K clusters; each score counts as if its cluster had been left out."""
    count = len(scores)
    if count < 2:
        return np.nan
    total = expected.sum(axis=0)
    found = 0.0
    for score, own in zip(scores, expected, strict=True):
        others = total - own
        move = np.linalg.pinv(others + 1e-3 * total, hermitian=True) @ score  # of theta, without the cluster
        found += float(move @ total @ move)
    return found * (count - 1.0) / count / len(total)


def inflated_covariance(fit: Fit, without: Sequence[np.ndarray], between: np.ndarray) -> tuple[np.ndarray, float]:
    """Covariance (6, 6) inflated by residuals and flights, and the factor on the formal standard deviations.

    Args:
        fit: of all flights.
        without: theta (6,) of fits that each leave one flight out; fewer than four say nothing here.
        between: (6,) by how much theta depends on how the wheels ran between the readings, kg m^2.
    """
    inflation = max([1.0, *(ratio for ratio in scatter(fit) if np.isfinite(ratio))])
    covariance = inflation * fit.covariance + np.outer(between, between)
    if len(without) >= _JACKKNIFE_MIN:
        left = np.array(without)
        jackknife = (len(left) - 1.0) / len(left) * ((left - left.mean(axis=0)) ** 2).sum(axis=0)
        wider = np.sqrt(np.maximum(jackknife / np.diag(covariance), 1.0))
        covariance = covariance * np.outer(wider, wider)
    return covariance, float(np.sqrt(inflation))


def determined(fit: Fit, covariance: np.ndarray, sizes: np.ndarray, gyro_std: float) -> np.ndarray:
    """(6,) whether the data determine each parameter: motion well above the gyro's noise, std below a quarter.

    A parameter's motion is that part of its regressor which no other parameter explains.
    """
    return (fit.signal > SIGNAL_MIN * gyro_std) & (np.sqrt(np.diag(covariance)) < STD_MAX * sizes)
