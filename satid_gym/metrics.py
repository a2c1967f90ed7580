"""Scores of an episode, and intervals over many: small functions of arrays.

Series have shape (T, N): T decisions of N episodes.
"""

from __future__ import annotations

import numpy as np
import scipy.stats

FINAL_FRACTION = 0.2  # the paper's window
SETTLING = 10.0  # s after a step of the inertia that consistency leaves out


def final_error(error: np.ndarray) -> np.ndarray:
    """Mean relative error over the last 20 % of each episode (N,): the paper's metric."""
    window = max(1, round(FINAL_FRACTION * len(error)))
    return error[-window:].mean(axis=0)


def mean_error(error: np.ndarray) -> np.ndarray:
    """Mean relative error over each episode (N,)."""
    return error.mean(axis=0)


def time_to(error: np.ndarray, time: np.ndarray, threshold: float = 0.01) -> np.ndarray:
    """First time (N,) at which the error is at most `threshold`; infinite where it never is."""
    reached = error <= threshold
    return np.where(reached.any(axis=0), time[reached.argmax(axis=0)], np.inf)


def consistency(nees: np.ndarray, time: np.ndarray, step_time: float | None = None) -> np.ndarray:
    """Mean NEES per degree of freedom of each episode (N,), leaving out NaN and the 10 s after a step of J."""
    keep = np.ones(len(time), bool)
    if step_time is not None:
        keep = (time < step_time) | (time > step_time + SETTLING)
    return np.nanmean(nees[keep], axis=0)


def iqm(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Interquartile mean: the mean of the middle half. Source: Agarwal et al., NeurIPS 2021."""
    return scipy.stats.trim_mean(values, 0.25, axis=axis)


def improvements(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """1 where an episode's error is lower than the other policy's on the same seed, 1/2 where equal, else 0.

    Its mean is the probability of improvement.
    """
    return np.where(values < others, 1.0, np.where(values == others, 0.5, 0.0))


def bootstrap(values: np.ndarray, statistic=np.mean, *, seed: int = 0, resamples: int = 2000) -> tuple[float, float]:
    """95 % interval (low, high) of a statistic of independent episodes (N,), by the BCa bootstrap.

    Degenerate samples, where every value is the same, give that value twice.
    """
    values = np.asarray(values, dtype=float)
    if len(values) < 2 or np.ptp(values) == 0.0:
        point = float(statistic(values))
        return point, point
    result = scipy.stats.bootstrap(
        (values,), statistic, n_resamples=resamples, vectorized=True, method="BCa", rng=np.random.default_rng(seed)
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)
