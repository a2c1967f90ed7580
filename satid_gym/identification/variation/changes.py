"""Tests of a course against the data: does the inertia step, does it drift, or is it constant.

Twice the gain in log-likelihood, with the scale c >= 1 of the errors estimated again, is compared with what a constant
inertia gives in `DRAWS` simulated ones; both tests together raise `FALSE_ALARM` of them. Between a step and a drift the
Bayesian information criterion decides.
Source: Andrews, Econometrica 61(4), 1993 (a step at an unknown instant); Wahba, Spline Models (1990), ch. 6 (a spline
against a polynomial); Schwarz, Annals of Statistics 6(2), 1978.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from satid_gym.identification.variation.course import Course
from satid_gym.identification.variation.knots import Balance

FALSE_ALARM = 0.01
DRAWS = 1000
_WALKS = np.concatenate([[0.0], np.logspace(-8.0, -1.0, 57)])  # q that are tried, s^-1.5
_TOLD = 1.0  # of nominal: standard deviation of a step, beyond which the data say nothing of it


@dataclass(frozen=True, eq=False, kw_only=True)
class Verdict:
    """Test of a course that is constant between its steps.

    Attributes:
        p: share of simulations of a constant inertia that vary at least as much.
        step_gain: (K,) twice the gain in log-likelihood of a step before each knot; 0 where no step is identifiable.
        step_limit: limit of the largest gain, at half the false-alarm rate.
        drift_gain: twice the gain in log-likelihood of the most likely drift.
        drift_limit: limit of it, at the other half of the rate.
    """

    p: float
    step_gain: np.ndarray
    step_limit: float
    drift_gain: float
    drift_limit: float

    @property
    def steps(self) -> bool:
        """Whether the gain of a step exceeds its limit."""
        return bool(self.step_gain.max() > self.step_limit)

    @property
    def drifts(self) -> bool:
        """Whether the gain of a drift exceeds its limit."""
        return self.drift_gain > self.drift_limit


class Likelihood:
    """Likelihood of a course for any q; its levels, and momentum jumps at the knots `jumps`, are projected out."""

    def __init__(self, balance: Balance, course: Course, jumps: tuple[int, ...] = ()) -> None:
        self.course, self.balance = course, balance
        self.jumps = np.hstack([np.zeros((len(balance.z), 0)), *(balance.M[:, 3 * k : 3 * k + 3] for k in jumps)])
        self.levels = _directions(np.hstack([balance.B @ course.levels, self.jumps]))[0]
        self.rest = self.project(balance.z)
        self.freedom = len(balance.z) - self.levels.shape[1]
        whole = balance.B @ course.sums if course.drifts else np.zeros((len(balance.z), 0))
        self.whole = _directions(whole)[1] ** 2
        self.axes, sizes = _directions(self.project(whole))
        self.variance = sizes**2

    def project(self, values: np.ndarray) -> np.ndarray:
        """Values (r, ...) minus their projection on the levels."""
        return np.asarray(values - self.levels @ (self.levels.T @ values))

    def scale(self, walk: float = 0.0) -> float:
        """c at a drift of size q."""
        return max(1.0, float(self._quadratic(self.rest, [walk])[0]) / self.freedom)

    def _quadratic(self, rest: np.ndarray, walks: np.ndarray | list[float]) -> np.ndarray:
        """(Q, ...) squares of residuals (r, ...) in units of their variance over c, for each q."""
        square, along = (rest**2).sum(axis=0), (self.axes.T @ rest) ** 2
        taken = [1.0 - 1.0 / (1.0 + walk**2 * self.variance) for walk in walks]
        return np.array([square - np.tensordot(share, along, axes=1) for share in taken])

    def fitted(self, rest: np.ndarray, walks: np.ndarray | list[float]) -> np.ndarray:
        """(Q, ...) twice the log-likelihood for each q."""
        lost = np.array([np.log1p(walk**2 * self.whole).sum() for walk in walks])
        return (2.0 * _profile(self._quadratic(rest, walks), len(rest)).T - lost).T

    def likeliest(self) -> tuple[float, float]:
        """q of a drift that maximises the restricted likelihood, and twice its log-likelihood."""
        if not self.course.drifts:
            return 0.0, float(self.fitted(self.rest, [0.0])[0])
        restricted = 2.0 * _profile(self._quadratic(self.rest, _WALKS), self.freedom)
        lost = [np.log1p(walk**2 * self.variance).sum() for walk in _WALKS]
        walk = float(_WALKS[np.argmax(restricted - lost)])
        return walk, float(self.fitted(self.rest, [walk])[0])

    def criterion(self) -> float:
        """Bayesian information criterion of the course with the most likely q; lower is better."""
        walk, fitted = self.likeliest()
        return (self.levels.shape[1] + len(self.course.starts) + (walk > 0.0)) * float(np.log(len(self.rest))) - fitted

    def estimate(self, walk: float) -> tuple[np.ndarray, np.ndarray]:
        """x (6 K,) and its covariance (6 K, 6 K) with a drift of size q."""
        course, count = replace(self.course, walk=walk), len(self.course.time)
        spread = np.hstack([course.spread, np.zeros((6 * count, self.jumps.shape[1]))])
        rows = np.hstack([self.balance.B @ course.spread, self.jumps])
        prior = np.zeros(rows.shape[1])
        prior[course.free : course.spread.shape[1]] = 1.0
        inverse = scipy.linalg.pinvh(rows.T @ rows + np.diag(prior))
        x = spread @ (inverse @ (rows.T @ self.balance.z))
        return x, self.scale(walk) * spread @ inverse @ spread.T

    def step_rows(self, k: int) -> np.ndarray:
        """(r, 6) of a step before knot k that lasts to the end of its segment."""
        segment = self.course.segment
        later = (np.arange(len(segment)) >= k) & (segment == segment[k])
        return self.balance.B.reshape(len(self.balance.B), -1, 6)[:, later].sum(axis=1)

    def step_directions(self) -> list[np.ndarray]:
        """Of a step before each knot, and a jump of the momentum, (r, 9) or fewer directions that the data tell."""
        segment, M = self.course.segment, self.balance.M
        found = [np.zeros((len(M), 0))]
        for k in range(1, len(segment)):
            if segment[k] == segment[k - 1]:
                rows = np.hstack([self.step_rows(k), M[:, 3 * k : 3 * k + 3]])
                found.append(_directions(self.project(rows), 1.0 / _TOLD)[0])
            else:
                found.append(found[0])
        return found

    def step_gains(self, rest: np.ndarray, directions: list[np.ndarray]) -> np.ndarray:
        """(K, ...) of twice the log-likelihood, for residuals (r, ...)."""
        square = (rest**2).sum(axis=0)
        base = _profile(square, len(rest))
        taken = [((basis.T @ rest) ** 2).sum(axis=0) for basis in directions]
        return np.array([2.0 * (_profile(square - part, len(rest)) - base) for part in taken])


def _profile(square: np.ndarray, freedom: int) -> np.ndarray:
    """Log-likelihood of the sum of squares at the best scale c >= 1."""
    scale = np.maximum(square / freedom, 1.0)
    return np.asarray(-0.5 * (freedom * np.log(scale) + square / scale))


def _directions(rows: np.ndarray, least: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal directions of rows (r, k), and their sizes, without those of size `least` or below."""
    if rows.shape[1] == 0:
        return rows, np.zeros(0)
    basis, values, _ = scipy.linalg.svd(rows, full_matrices=False)
    keep = values > max(least, 1e-9 * values[0])
    return basis[:, keep], values[keep]


def judge(balance: Balance, course: Course, rng: np.random.Generator) -> Verdict:
    """Both tests of a course that is constant between its steps."""
    constant, drift = Likelihood(balance, course), Likelihood(balance, replace(course, drifts=True))
    directions = constant.step_directions()

    def gains(rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        drifting = drift.fitted(drift.project(rest), _WALKS).max(axis=0)
        return constant.step_gains(rest, directions), drifting - constant.fitted(rest, [0.0])[0]

    drawn = constant.project(rng.standard_normal((len(balance.z), DRAWS))) * np.sqrt(constant.scale())
    steps, drifts = gains(drawn)
    steps = steps.max(axis=0)
    step_limit, drift_limit = (float(np.quantile(found, 1.0 - 0.5 * FALSE_ALARM)) for found in (steps, drifts))
    step_gain, drift_gain = gains(constant.rest)
    seen = max(float(step_gain.max()) / step_limit, float(drift_gain) / drift_limit)
    return Verdict(
        p=float((np.maximum(steps / step_limit, drifts / drift_limit) >= seen).sum() + 1) / (DRAWS + 1),
        step_gain=step_gain,
        step_limit=step_limit,
        drift_gain=float(drift_gain),
        drift_limit=drift_limit,
    )
