"""From the scores of episodes to records: means with 95 % intervals, and pairs on the same seeds.

Errors are fractions. Intervals are BCa bootstrap over episodes; "_lo" and "_hi" are their ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from satid_gym.metrics import bootstrap, improvements, iqm

Scores = Mapping[str, np.ndarray]


def record(scores: Scores) -> dict[str, float | None]:
    """Statistics of one policy in one cell from the scores (N,) of its episodes.

    A median time to 1 % that is infinite, and a NEES that no episode has, are None.
    """
    return {
        **_with_interval("final_error", "final_error_mean", scores["final_error"], np.mean),
        **_with_interval("final_error_iqm", "final_error_iqm", scores["final_error"], iqm),
        **_with_interval("mean_error", "mean_error_mean", scores["mean_error"], np.mean),
        "time_to_1pct_s": _finite(np.median(scores["time_to_1pct_s"])),
        "outside_fraction": float(scores["outside_fraction"].mean()),
        "information_nats": float(scores["information_nats"].mean()),
        "nees": _finite(scores["nees"].mean()),
        "effort": float(scores["effort"].mean()),
        "saturated_fraction": float(scores["saturated_fraction"].mean()),
        "terminated_fraction": float(scores["terminated"].mean()),
        "reward": float(scores["reward"].mean()),
    }


def pair(scores: Scores, others: Scores) -> dict[str, float]:
    """One policy against another on the same seeds, by final error.

    Probability of improvement, and the mean difference: below 0 where the first policy is better.
    """
    mine, theirs = scores["final_error"], others["final_error"]
    wins, difference = improvements(mine, theirs), mine - theirs
    return {
        **_with_interval("probability_of_improvement", "probability_of_improvement", wins, np.mean),
        **_with_interval("difference", "difference_mean", difference, np.mean),
    }


def _with_interval(name: str, point: str, values: np.ndarray, statistic: Any) -> dict[str, float]:
    low, high = bootstrap(values, statistic)
    return {point: float(statistic(values)), f"{name}_lo": low, f"{name}_hi": high}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
