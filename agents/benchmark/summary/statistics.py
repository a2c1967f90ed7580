"""Statistics of the scores of episodes: means with 95 % intervals, and pairs on the same seeds.

Errors are fractions. Intervals are the studentised bootstrap over episodes, and Clopper and Pearson's for shares of
wins; "_lo" and "_hi" are their ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from satid_gym.metrics import bootstrap, improvements, iqm, proportion_interval

Scores = Mapping[str, np.ndarray]
PAIRED_KINDS = ("learned", "closed_loop")  # kinds of policies that are compared with every other one in pairs


def record(scores: Scores) -> dict[str, float | None]:
    """Statistics of one policy in one cell from the scores (N,) of its episodes.

    A median time to 1 % that is infinite, and a NEES that no episode has, are None.
    """
    return {
        **_with_interval("final_error", "final_error_mean", scores["final_error"], least=0.0),
        "final_error_iqm": float(iqm(scores["final_error"])),
        **_ends("final_error_iqm", bootstrap(scores["final_error"], trim=0.25), least=0.0),
        **_with_interval("mean_error", "mean_error_mean", scores["mean_error"], least=0.0),
        "time_to_1pct_s": _finite(np.median(scores["time_to_1pct_s"])),
        "outside_fraction": float(scores["outside_fraction"].mean()),
        "information_nats": float(scores["information_nats"].mean()),
        "nees": _finite(scores["nees"].mean()),
        "effort": float(scores["effort"].mean()),
        "saturated_fraction": float(scores["saturated_fraction"].mean()),
        "terminated_fraction": float(scores["terminated"].mean()),
        "reward": float(scores["reward"].mean()),
        "cost": float(scores["cost"].mean()),
    }


def pair(scores: Scores, others: Scores) -> dict[str, float]:
    """One policy against another on the same seeds, by final error.

    Probability of improvement, and the mean difference: below 0 where the first policy is better.
    """
    mine, theirs = scores["final_error"], others["final_error"]
    wins, difference = improvements(mine, theirs), mine - theirs
    return {
        "probability_of_improvement": float(wins.mean()),
        **_ends("probability_of_improvement", proportion_interval(wins)),
        **_with_interval("difference", "difference_mean", difference),
    }


def _with_interval(name: str, point: str, values: np.ndarray, least: float = -np.inf) -> dict[str, float]:
    return {point: float(values.mean()), **_ends(name, bootstrap(values), least)}


def _ends(name: str, interval: tuple[float, float], least: float = -np.inf) -> dict[str, float]:
    """Ends of an interval, which with few episodes can reach below the least value there is."""
    return {f"{name}_lo": max(interval[0], least), f"{name}_hi": interval[1]}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
