"""The study of faults: its scores by numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.studies.faults import CASES, recovery, scores, worlds
from satid_gym.evaluation import Flight
from tests.cases import cases


def flight(episodes: int = 1, period: float = 1.0, horizon: float = 300.0, **series: np.ndarray) -> Flight:
    """A flight that is perfect but for `series`; decision k ends at (k + 1) `period`."""
    shape = (round(horizon / period), episodes)
    flat = {name: np.zeros(shape) for name in ("outside", "information", "effort", "reward", "saturated", "cost")}
    always = {name: np.ones(shape, bool) for name in ("alive", "settled")}
    values = {**flat, **always, "error": np.zeros(shape), "nees": np.ones(shape), **series}
    values["terminated"] = ~values["alive"][-1]
    return Flight(time=period * np.arange(1, shape[0] + 1), **values)


def error(bad: list[tuple[float, float]], period: float = 1.0, horizon: float = 300.0) -> np.ndarray:
    """1 % at the ends of decisions that lie within one of the closed ranges of time `bad`, else 0.5 %, (T, 1)."""
    time = period * np.arange(1, round(horizon / period) + 1)
    return np.where(np.any([(a <= time) & (time <= b) for a, b in bad], axis=0), 0.01, 0.005)[:, None]


@cases(
    ("bad", "seconds"),
    [
        ([(1, 139)], 0.0),  # good when the fault ends, and from then on
        ([(1, 140)], 1.0),
        ([(1, 147)], 8.0),
        ([(1, 140), (150, 150)], 11.0),  # good from 141 s on, but for 9 s only; then from 151 s
        ([(1, 140), (151, 151)], 12.0),  # from 141 s to 150 s is 9 s
        ([(1, 140), (152, 152)], 1.0),  # from 141 s to 151 s is 10 s
        ([(1, 289)], 150.0),
        ([(1, 290)], np.inf),  # good for the last 9 s, which is not enough
    ],
)
def test_recovery_is_the_time_after_the_fault_from_which_the_error_stays_low(bad, seconds):
    assert recovery(flight(error=error(bad)), 140.0).tolist() == [seconds]


def test_recovery_with_decisions_of_half_a_second():
    """20 decisions are 10 s: from 145.5 s on, for 9.5 s at first."""
    assert recovery(flight(period=0.5, error=error([(0, 145)], 0.5)), 140.0).tolist() == [5.5]
    assert recovery(flight(period=0.5, error=error([(0, 145), (155.5, 155.5)], 0.5)), 140.0).tolist() == [16.0]


@cases(
    ("bad", "end", "seconds"),
    [
        ([(1, 139)], 140.3, 0.7),  # the first error known of the time without fault is that of 141 s
        ([(1, 140)], 140.3, 0.7),
        ([(1, 141)], 140.3, 1.7),
        ([(1, 139)], 140.7, 0.3),
        ([(1, 139)], 140.0 + 1e-9, 0.0),  # rounding is no decision later
        ([(1, 139)], 140.0 - 1e-9, 0.0),
    ],
)
def test_recovery_from_a_fault_that_ends_within_a_decision(bad, end, seconds):
    found = recovery(flight(error=error(bad)), end)
    assert found == pytest.approx([seconds], abs=1e-8)
    assert found >= 0.0


def test_who_ends_early_does_not_recover():
    alive = np.ones((300, 1), bool)
    alive[150:] = False
    assert recovery(flight(alive=alive), 145.0).tolist() == [np.inf]


def test_scores_by_window():
    """NEES 1 before the fault (120 s), 2 while it lasts (to 140 s), 4 for 10 s after, then 3; the second ends early."""
    nees = np.repeat([1.0, 2.0, 4.0, 3.0], [120, 20, 10, 150])[:, None] * [1.0, 2.0]
    alive = np.ones((300, 2), bool)
    alive[200:, 1] = False
    error_two = np.hstack([error([(1, 147)]), error([(1, 290)])])
    outside = np.zeros((300, 2))
    outside[:30] = 1.0
    found = scores(flight(2, nees=nees, alive=alive, error=error_two, outside=outside), 20.0)
    assert found["nees_before"] == pytest.approx(1.5)
    assert found["nees_during"] == pytest.approx(3.0)
    assert found["nees_after"] == pytest.approx((150 * 3.0 + 50 * 6.0) / 200)
    assert found["nees_worst"] == pytest.approx(3.0 + 0.95 * 3.0)
    assert found["final_error"] == pytest.approx((0.005 + (50 * 0.01 + 10 * 0.005) / 60) / 2)
    assert (found["recovery_s"], found["recovery_s_95"]) == (None, None)  # of 8 s and never, the median is never
    assert (found["outside"], found["terminated"]) == (0.1, 0.5)


def test_a_case_has_its_fault_alone_and_both_filters():
    for case, (faults, _) in CASES.items():
        ungated, gated = worlds(case).values()
        assert ungated.faults == gated.faults == faults
        assert ungated.to_dict()["estimator"] != gated.to_dict()["estimator"]
    assert not worlds("none")["gated"].faults.possible
    assert worlds("gyro outliers")["gated"].faults.gyro_outlier > 0.0
    assert worlds("gyro outliers")["gated"].faults.tachometer_stuck == 0.0
