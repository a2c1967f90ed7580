"""Flights one by one: the contribution of each, and how well the others predict it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.estimators.batch.fit import NotIdentifiedError
from satid_gym.identification.bad_readings.faults import TachometerFault, wheel_residuals
from satid_gym.identification.estimate import Estimated, estimate, theta_sizes
from satid_gym.identification.judgement import determined
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

OUTLIER = 0.1  # weight below which an instant counts as an outlier
_PARTS = 5  # into which a single log is cut


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightReport:
    """Contribution of one flight.

    Attributes:
        name: of the log.
        rows, used: rows of the log, and those in windows.
        outliers: stamps, s, of the instants that were weighed out.
        faults: readings of tachometers that were left out.
        theta: (6,) from this flight alone, kg m^2; NaN where it does not tell.
        std: (6,) its formal standard deviations.
        share: (6,) of the information about each parameter.
        delays: (2,) s, of wheel speeds and of attitude; NaN without one.
        time: (N,) s, of the residuals.
        told: (N, 6) share of the information about each parameter that each of these instants gave.
        residual: (N, n) wheel speeds as measured less as balanced, rad/s.
        predicted: rad/s, robust size of the same with theta of the other flights (of the other parts of a single log);
            NaN where there are no others.
        signal: rad/s, standard deviation of the wheel speeds.
    """

    name: str
    rows: int
    used: int
    outliers: np.ndarray
    faults: tuple[TachometerFault, ...]
    theta: np.ndarray
    std: np.ndarray
    share: np.ndarray
    delays: np.ndarray
    time: np.ndarray
    told: np.ndarray
    residual: np.ndarray
    predicted: float
    signal: float


def parts_of(logs: Sequence[Log], window: float) -> list[Log]:
    """The logs, or a single one cut into parts of a window or more."""
    if len(logs) > 1:
        return list(logs)
    (log,) = logs
    count = min(_PARTS, int((log.time[-1] - log.time[0]) / window))
    if count < 2:
        return [log]
    edges = np.linspace(log.time[0], log.time[-1], count + 1)[1:-1]
    which = np.searchsorted(edges, log.time)
    return [log.rows(which == k) for k in range(count) if (which == k).sum() > 2]


def folds(logs: Sequence[Log], satellite: Satellite, window: float) -> dict[int, np.ndarray]:
    """Theta (6,) without each flight, or without each part of a single log."""
    parts = parts_of(logs, window)
    if len(parts) < 2:
        return {}
    found = {}
    for number in range(len(parts)):
        others = [part for k, part in enumerate(parts) if k != number]
        try:
            found[number] = estimate(others, satellite, window, turns=2).fit.theta
        except NotIdentifiedError:
            continue
    return found


def flight_reports(
    logs: Sequence[Log],
    satellite: Satellite,
    window: float,
    estimated: Estimated,
    without: dict[int, np.ndarray],
    faults: Sequence[TachometerFault],
) -> list[FlightReport]:
    """One report a flight."""
    fit, sizes = estimated.fit, theta_sizes(satellite)
    flown = sorted({row.flight for row in estimated.windows})
    total = np.sum([np.diag(share.information) for share in fit.flights], axis=0)
    told = np.maximum(np.sum([rows.sum(axis=0) for share in fit.flights for rows in share.told], axis=0), 1e-300)
    predicted = _predictions(parts_of(logs, window), satellite, window, without)
    found = []
    for number, log in enumerate(logs):
        mine = [k for k, row in enumerate(estimated.windows) if row.flight == number]
        information = np.diag(fit.flights[flown.index(number)].information) if mine else np.zeros(6)
        theta, std = _alone(log, satellite, window, sizes)
        times = [estimated.windows[k].time for k in mine]
        wheels = [wheel_residuals(fit.residuals[k], satellite.wheels) for k in mine]
        out = [estimated.windows[k].time[fit.weights[k] < OUTLIER] for k in mine]
        found.append(
            FlightReport(
                name=log.name,
                rows=len(log),
                used=sum(len(estimated.windows[k]) for k in mine),
                outliers=np.concatenate(out) if out else np.zeros(0),
                faults=tuple(fault for fault in faults if fault.flight == number),
                theta=theta,
                std=std,
                share=information / np.maximum(total, 1e-300),
                delays=np.where(np.isfinite(estimated.delays_std[number]), estimated.delays[number], np.nan),
                time=np.concatenate(times) if times else np.zeros(0),
                told=np.concatenate(fit.flights[flown.index(number)].told) / told if mine else np.zeros((0, 6)),
                residual=np.concatenate(wheels) if wheels else np.zeros((0, satellite.wheels.count)),
                predicted=_size(
                    predicted[number] if len(logs) > 1 else [r for rows in predicted.values() for r in rows]
                ),
                signal=float(np.nanmax(np.nanstd(log.wheel_speed, axis=0))),
            )
        )
    return found


def _alone(log: Log, satellite: Satellite, window: float, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    try:
        fit = estimate([log], satellite, window).fit
    except (NotIdentifiedError, np.linalg.LinAlgError):
        return np.full(6, np.nan), np.full(6, np.nan)
    known = determined(fit, fit.covariance, sizes, satellite.gyro_noise_std)
    return np.where(known, fit.theta, np.nan), np.where(known, np.sqrt(np.diag(fit.covariance)), np.nan)


def _predictions(
    parts: Sequence[Log], satellite: Satellite, window: float, without: dict[int, np.ndarray]
) -> dict[int, list[np.ndarray]]:
    """Residuals (N, n), rad/s, of each part with theta of the others; momentum and delays are the part's own."""
    found: dict[int, list[np.ndarray]] = {number: [] for number in range(len(parts))}
    for number, theta in without.items():
        try:
            own = estimate([parts[number]], satellite, window, given=theta, turns=2)
        except NotIdentifiedError:
            continue
        found[number] = [wheel_residuals(rows, satellite.wheels) for rows in own.fit.residuals]
    return found


def _size(parts: Sequence[np.ndarray]) -> float:
    """Robust standard deviation."""
    return 1.4826 * float(np.median(np.abs(np.concatenate(parts)))) if len(parts) else np.nan
