"""Estimators of the study: the paper's two, and ours on the same readings.

"ls_alike" is the paper's LS with wheel accelerations from the same central differences as those of the rates. It
measures the cost of that mismatch in the paper's LS and is in no table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from baselines.paper.flight import ProfileFlight
from baselines.paper.world import MOMENTUM_SETTINGS, prior
from satid_gym.estimators import FilterRun, MomentumEKF, MomentumSmoother, RateEKF
from satid_gym.estimators.least_squares import (
    InertiaFit,
    NotIdentifiedError,
    differentiated,
    momentum_form,
    output_error,
)

METHODS: dict[str, str] = {
    "ls": "LS",
    "ekf": "EKF",
    "ls_alike": "LS, wheel speeds differenced as the rates",
    "momentum_ls": "momentum LS",
    "output_error": "output error",
    "momentum_ekf": "MomentumEKF",
    "momentum_rts": "MomentumEKF + RTS",
}
PAPER_METHODS = ("ls", "ekf")
OUR_METHODS = ("momentum_ls", "output_error", "momentum_ekf", "momentum_rts")


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """Estimate of one estimator from one record.

    Attributes:
        inertia: (N + 1, 3) estimated principal moments at each reading, kg m^2; NaN where not identified.
        std: (N + 1, 3) kg m^2.
        condition: condition number of the regression; None for filters.
    """

    inertia: np.ndarray
    std: np.ndarray
    condition: float | None = None


def wheel_acceleration(flight: ProfileFlight, row: int) -> np.ndarray:
    """Wheel acceleration (N + 1, n), rad/s^2, in the interval before each reading, as in the paper."""
    change = np.diff(flight.wheel_speed[:, row], axis=0, prepend=flight.wheel_speed[:1, row])
    return change / flight.dt


def estimate(flight: ProfileFlight, row: int, methods: tuple[str, ...] = tuple(METHODS)) -> dict[str, Estimate]:
    """Estimates of one episode, by method."""
    known = prior(flight.satellite, flight.horizon)
    record = known, flight.gyro[:, row], flight.wheel_speed[:, row], flight.dt
    found: dict[str, Estimate] = {}
    if "ls" in methods:
        acceleration = wheel_acceleration(flight, row)
        found["ls"] = _batch(flight, lambda: differentiated(*record, wheel_acceleration=acceleration))
    if "ls_alike" in methods:
        found["ls_alike"] = _batch(flight, lambda: differentiated(*record))
    if "ekf" in methods:
        found["ekf"] = _filtered(RateEKF().run(*record))
    if "momentum_ls" in methods:
        found["momentum_ls"] = _batch(flight, lambda: momentum_form(*record))
    if "output_error" in methods:
        found["output_error"] = _batch(flight, lambda: output_error(*record))
    if "momentum_ekf" in methods or "momentum_rts" in methods:
        settings = MOMENTUM_SETTINGS.to_dict()
        forward = MomentumEKF(**settings).run(*record)
        if "momentum_ekf" in methods:
            found["momentum_ekf"] = _filtered(forward)
        if "momentum_rts" in methods:
            smoothed = MomentumSmoother(**settings).correct(forward, known, record[2], flight.dt)
            found["momentum_rts"] = _filtered(smoothed)
    return found


def _filtered(run: FilterRun) -> Estimate:
    return Estimate(
        inertia=run.inertia, std=np.sqrt(np.diagonal(run.inertia_covariance, axis1=1, axis2=2)), condition=None
    )


def _batch(flight: ProfileFlight, solve: Callable[[], InertiaFit]) -> Estimate:
    """One estimate for the whole record; NaN, shown in the tables, if the data do not identify the inertia."""
    shape = len(flight.time), 3
    try:
        fit = solve()
    except NotIdentifiedError:
        return Estimate(inertia=np.full(shape, np.nan), std=np.full(shape, np.nan))
    return Estimate(
        inertia=np.broadcast_to(fit.theta, shape),
        std=np.broadcast_to(np.sqrt(np.diag(fit.covariance)), shape),
        condition=fit.condition,
    )
