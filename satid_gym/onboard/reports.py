"""Reports of the pilot: its status, and its filter's estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.onboard import kernels

State = Literal["waiting", "flying", "coasting", "over"]
_COUNTED = ("missing", "refused", "rejected", "repeated", "late", "ahead", "missed")


@dataclass(kw_only=True)
class Status:
    """State of the pilot, and problems of the readings so far.

    Attributes:
        state: "waiting" for `start`; "flying"; "coasting", with zero torque, because readings are missing or the filter
            has failed; "over", with zero torque, after the scenario's horizon.
        message: what was wrong with the last readings, in one line; empty where nothing was.
        counts: how often readings were "missing" (None), "refused" (not finite, or beyond any limit), "rejected" (by
            the filter's gate), "repeated" (the same time stamp again), "late" (an earlier time stamp), "ahead" (a
            stamp far ahead that the next did not confirm, or has yet to); and "missed", decisions
            that were skipped, because no good reading came before the next was due.
    """

    state: State = "waiting"
    message: str = ""
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_COUNTED, 0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """Estimate of the filter at one instant, body frame, SI units.

    Attributes:
        time: time of the last readings that the filter used, s.
        names: (p,) inertia parameters: Jxx, Jyy, Jzz, and Jxy, Jxz, Jyz where all six are estimated.
        theta: (p,) their estimates, kg m^2.
        covariance: (p, p), including the uncertainty of the rotors' common factor by the data sheet.
        inertia: (3, 3) kg m^2.
        mean, state_covariance: (size,) and (size, size) of the filter's whole state.
        nis: normalised innovation squared of the last update per degree of freedom; NaN before the first.
        nis_mean: its running mean: 1 of a consistent filter.
        colour: how alike innovations are from one to the next, over its limit, see `satid_gym.core.belief.whiteness`.
        unmodelled: whether one of these two is beyond its limit, or the estimate of a mode four standard deviations off
            the data sheet: readings are not those that the data sheet leads to, and neither estimate nor covariance can
            be trusted. What to do about it, docs/unmodelled.md says.
        accepted: whether the filter accepted the gyro's last reading; if not, it continues with its own rate.
    """

    time: float
    names: tuple[str, ...]
    theta: np.ndarray
    covariance: np.ndarray
    inertia: np.ndarray
    mean: np.ndarray
    state_covariance: np.ndarray
    nis: float
    nis_mean: float
    colour: float
    unmodelled: bool
    accepted: bool

    @property
    def std(self) -> np.ndarray:
        """(p,) standard deviations of theta, kg m^2."""
        return np.sqrt(np.diag(self.covariance))


def estimate_of(beliefs: np.ndarray, time: float, nis: float) -> Estimate:
    """Estimate of a belief record, an array of one, at a time, s, after an update with that NIS."""
    belief, reports = beliefs[0], np.zeros(1, kernels.report_dtype())
    kernels.tell(beliefs, reports)
    report = reports[0]
    p = len(belief["prior_theta"])
    theta = belief["mean"][3 : 3 + p].copy()
    block = belief["covariance"][3 : 3 + p, 3 : 3 + p]
    return Estimate(
        time=time,
        names=NAMES[:p],
        theta=theta,
        covariance=block + belief["scale_variance"] * np.outer(theta, theta),
        inertia=inertia_tensors(theta),
        mean=belief["mean"].copy(),
        state_covariance=belief["covariance"].copy(),
        nis=nis,
        nis_mean=float(report["nis_mean"]),
        colour=float(report["colour"]),
        unmodelled=bool(report["unmodelled"]),
        accepted=not belief["coasting"],
    )
