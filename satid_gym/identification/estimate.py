"""Estimate from logs: windows and fit in alternation, since delays are known only once theta is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.estimators.batch.fit import NotIdentifiedError
from satid_gym.estimators.inertia import PRODUCTS, inertia_parameters
from satid_gym.identification.fit import Fit, fit
from satid_gym.identification.flexible_body.modal_momentum import flexible_windows
from satid_gym.identification.rows import ROWS_MIN, Window
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_TURNS = 4
_TOLD = 0.9  # of a delay's prior: with a larger standard deviation the data say nothing of it
_TORQUES = 10.0  # of the data sheet's disturbance: a prior that hardly binds
_BIAS_STD = 1e-2  # rad/s, of a gyro whose data sheet says nothing: 0.6 deg/s, an uncalibrated MEMS gyro


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimated:
    """A fit with the windows it is of, and the delays (F, 2), s, of wheel speeds and attitude against the gyro.

    The standard deviation of a delay that was not estimated is infinite; `biases` (F, 3), rad/s, are the gyros'.
    """

    fit: Fit
    windows: list[Window]
    delays: np.ndarray
    delays_std: np.ndarray
    biases: np.ndarray


def common_stds(logs: Sequence[Log], satellite: Satellite) -> np.ndarray:
    """(8,) prior standard deviations of a flight's common unknowns: bias, rad/s, torque, N m, and delays, s."""
    bias = satellite.tolerances.gyro_bias or _BIAS_STD
    interval = max(log.interval for log in logs)
    return np.array([*[bias] * 3, *[_TORQUES * satellite.disturbance_std] * 3, interval, interval])


def theta_sizes(satellite: Satellite) -> np.ndarray:
    """(6,) nominal moments, and geometric means of two of them for the products, kg m^2."""
    moments = np.diag(satellite.inertia)
    return np.array([*moments, *(np.sqrt(moments[i] * moments[j]) for i, j in PRODUCTS)])


def all_windows(
    logs: Sequence[Log],
    satellite: Satellite,
    window: float,
    theta: np.ndarray,
    delays: np.ndarray,
    biases: np.ndarray,
    *,
    straight: bool = False,
    modes: bool = True,
) -> list[Window]:
    """Windows of all logs, at the present estimate of theta (6,), and of delays (F, 2) and biases (F, 3) of each."""
    return [
        row
        for number, log in enumerate(logs)
        for row in flexible_windows(
            log, number, satellite, theta, delays[number], biases[number], window, straight=straight, modes=modes
        )
    ]


def estimate(
    logs: Sequence[Log],
    satellite: Satellite,
    window: float,
    *,
    given: np.ndarray | None = None,
    turns: int = _TURNS,
    straight: bool = False,
) -> Estimated:
    """Theta from logs, with the delays of each.

    Args:
        logs: one a flight.
        satellite: nominal; its inertia is where the search starts, its wheels, gyro, panels and tanks are taken as
            built.
        window: s.
        given: (6,) kg m^2 that is taken as it is.
        turns: how often the windows are built again.
        straight: whether wheel speeds run on straight lines between readings.

    Raises:
        NotIdentifiedError: no log has a window with enough readings.
    """
    theta = inertia_parameters(satellite.inertia, "full") if given is None else given
    delays, delays_std = np.zeros((len(logs), 2)), np.full((len(logs), 2), np.inf)
    biases = np.zeros((len(logs), 3))
    sizes = theta_sizes(satellite)
    common_std, interval = common_stds(logs, satellite), max(log.interval for log in logs)
    for _ in range(turns):
        windows = all_windows(logs, satellite, window, theta, delays, biases, straight=straight)
        if not windows:
            raise NotIdentifiedError(
                f"no stretch of {ROWS_MIN} good readings without a gap or a turn of more than 0.3 rad between two of "
                "them: there is nothing to identify from"
            )
        found = fit(windows, sizes, common_std, given=given)
        theta = found.theta
        flown = sorted({row.flight for row in windows})
        for number, share in zip(flown, found.flights, strict=True):
            biases[number] += share.common[:3]
            lag = share.common[6:]
            delays[number, : len(lag)] += np.clip(lag, -2.0 * interval, 2.0 * interval)
            told = share.common_std[6:] < _TOLD * interval
            delays_std[number, : len(lag)] = np.where(told, share.common_std[6:], np.inf)
    return Estimated(fit=found, windows=windows, delays=delays, delays_std=delays_std, biases=biases)
