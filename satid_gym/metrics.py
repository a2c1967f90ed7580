"""Scores of episodes, and confidence intervals over them: small functions of arrays.

Series have shape (T, N): T decisions of N episodes.
"""

from __future__ import annotations

import numpy as np
import scipy.stats

FINAL_FRACTION = 0.2  # the paper's window
BEYOND_MAX = 0.01  # share of the time beyond the envelope, up to which a policy counts as inside it
_BOOTSTRAP_MIN = 20  # episodes; with fewer, Student's t alone gives the interval
SETTLING = 10.0  # s of turning after a step of the inertia, left out of the consistency
_TURNING = 0.1  # of the rate limit; a reading there says a hundredth of what it says at the limit


def relative_error(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Relative error (...) of inertia tensors: |estimate - truth| / |truth| in the Frobenius norm, the paper's metric.

    Args:
        estimate: (..., 3, 3) kg m^2, body frame; NaN without an estimate.
        truth: (..., 3, 3) kg m^2, body frame.
    """
    return np.linalg.norm(estimate - truth, axis=(-2, -1)) / np.linalg.norm(truth, axis=(-2, -1))


def final_error(error: np.ndarray) -> np.ndarray:
    """Mean relative error over the last 20 % of each episode (N,): the paper's metric."""
    window = max(1, round(FINAL_FRACTION * len(error)))
    return error[-window:].mean(axis=0)


def mean_error(error: np.ndarray) -> np.ndarray:
    """Mean relative error over each episode (N,)."""
    return error.mean(axis=0)


def time_to(error: np.ndarray, time: np.ndarray, threshold: float = 0.01) -> np.ndarray:
    """First time (N,) at which the error is at most `threshold`; infinite if never."""
    reached = error <= threshold
    return np.where(reached.any(axis=0), time[reached.argmax(axis=0)], np.inf)


def turns(rate: np.ndarray, rate_limit: np.ndarray | float) -> np.ndarray:
    """Whether (...) a body is faster than 10 % of its rate limit, on any axis; a slower one hardly shows a step of J.

    Args:
        rate: (..., 3) rad/s.
        rate_limit: (...) or one for all, rad/s.
    """
    return np.abs(rate).max(axis=-1) > _TURNING * rate_limit


def settled(stepped: np.ndarray, turning: np.ndarray, period: float) -> np.ndarray:
    """Where (T, N) a filter can know the inertia: before a step, and again after 10 s in which the body turned.

    No reading depends on the inertia of a body at rest, so the clock alone does not tell.

    Args:
        stepped: (T, N) whether the inertia has stepped.
        turning: (T, N) whether the body `turns`.
        period: s from one row to the next.
    """
    return ~stepped | (period * np.cumsum(stepped & turning, axis=0) > SETTLING)


def consistency(nees: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """Mean NEES per degree of freedom (N,) of each episode where it is `settled`, without NaN; NaN where it never is.

    Args:
        nees: (T, N).
        judged: (T, N) where it is settled.
    """
    counts = judged & ~np.isnan(nees)
    with np.errstate(invalid="ignore"):
        return np.where(counts, nees, 0.0).sum(axis=0) / counts.sum(axis=0)


def beyond_envelope(outside_fraction: float, saturated_fraction: float) -> float:
    """Share of the time beyond the envelope: the larger of the two shares below.

    Args:
        outside_fraction: share of the time with a body rate outside its limit.
        saturated_fraction: share of time and wheels at the speed limit.
    """
    return max(outside_fraction, saturated_fraction)


def iqm(values: np.ndarray) -> np.ndarray:
    """Interquartile mean along the last axis: the mean of the middle half. Source: Agarwal et al., NeurIPS 2021."""
    return scipy.stats.trim_mean(values, 0.25, axis=-1)


def improvements(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """1 where an episode's error is lower than the other policy's on the same seed, 1/2 where equal, else 0.

    Its mean is the probability of improvement.
    """
    return np.where(values < others, 1.0, np.where(values == others, 0.5, 0.0))


def bootstrap(values: np.ndarray, *, trim: float = 0.0, seed: int = 0, resamples: int = 2000) -> tuple[float, float]:
    """95 % interval (low, high) of a mean over independent episodes (N,), by the studentised bootstrap.

    For skewed errors its coverage is better than that of percentile and BCa intervals, as measured by
    `python -m tests.qa.interval_coverage`. On either side it is at least as long as Student's t interval, because a
    sample may not show the tails. With fewer than 20 episodes it is Student's t interval. If all values that the mean
    keeps are equal, both ends are that value.

    Args:
        values: (N,) one number per episode.
        trim: share of the values that the mean leaves out at either end; 0.25 gives the interquartile mean.
        seed: of the resampling.
        resamples: number of resamples.

    Source: Efron and Tibshirani 1993, section 12.5, with the trimmed mean's standard error of Tukey and
    McLaughlin 1963.
    """
    values = np.asarray(values, dtype=float)
    count = len(values)
    if count < 2:
        return float(values.mean()), float(values.mean())
    point, error = map(float, _trimmed_mean(values, trim))
    if error == 0.0:
        return point, point
    low, high = scipy.stats.t.ppf((0.025, 0.975), count - 2 * int(trim * count) - 1)
    if count >= _BOOTSTRAP_MIN:
        drawn = values[np.random.default_rng(seed).integers(0, count, (resamples, count))]
        means, errors = _trimmed_mean(drawn, trim)
        spread = errors > 0.0  # a resample of equal values has no scale
        ends = np.quantile((means - point)[spread] / errors[spread], (0.025, 0.975))
        low, high = min(low, ends[0]), max(high, ends[1])
    return float(point - high * error), float(point - low * error)


def proportion_interval(shares: np.ndarray) -> tuple[float, float]:
    """95 % interval (low, high) of the mean of shares (N,) within [0, 1], such as those of `improvements`.

    The interval of Clopper and Pearson, whose coverage is at least 95 % for every true share. Wilson's covers less
    for some shares, and a bootstrap of 100 wins out of 100 has no width. Ties, which count 1/2, make it wider.
    Source: Clopper and Pearson 1934.
    """
    count, wins = len(shares), float(np.sum(shares))
    low = float(scipy.stats.beta.ppf(0.025, wins, count - wins + 1.0)) if wins > 0.0 else 0.0
    high = float(scipy.stats.beta.ppf(0.975, wins + 1.0, count - wins)) if wins < count else 1.0
    return low, high


def _trimmed_mean(values: np.ndarray, trim: float) -> tuple[np.ndarray, np.ndarray]:
    """Trimmed mean over the last axis, and its standard error: the winsorised deviation over the share kept."""
    count = values.shape[-1]
    cut = int(trim * count)
    if cut > 0:
        values = np.sort(values, axis=-1)
    kept = values[..., cut : count - cut]
    winsorised = np.clip(values, kept[..., :1], kept[..., -1:]) if cut > 0 else values
    return kept.mean(axis=-1), winsorised.std(axis=-1, ddof=1) / ((1.0 - 2.0 * trim) * np.sqrt(count))
