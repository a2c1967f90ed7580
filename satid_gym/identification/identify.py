"""Identification of a satellite's inertia from recorded flights."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.config import check_number
from satid_gym.estimators.batch.fit import NotIdentifiedError
from satid_gym.estimators.batch.regression import NAMES, SIGNAL_MIN, STD_MAX
from satid_gym.estimators.batch.second_moment import nearest_physical
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.identification.bad_readings.faults import fault_notes, tachometer_faults, without_faults
from satid_gym.identification.bad_readings.notes import reading_notes, with_notes
from satid_gym.identification.bad_readings.saturation import without_saturated
from satid_gym.identification.bad_readings.spikes import without_spikes
from satid_gym.identification.delays import Parameter, delay_notes, delays_of
from satid_gym.identification.estimate import estimate, theta_sizes
from satid_gym.identification.fit import Fit
from satid_gym.identification.flexible_body.body import flexible
from satid_gym.identification.flights import FlightReport, flight_reports, folds
from satid_gym.identification.gyro_scale import gyro_scale
from satid_gym.identification.judgement import Whiteness, determined, inflated_covariance, scatter, whiteness
from satid_gym.identification.rotors import contradicted, rotor_inertias, rotor_notes
from satid_gym.identification.rows import ROWS_MIN
from satid_gym.identification.slips.checks import check_attitude, check_fit, check_motion
from satid_gym.identification.tolerances import alignment_tolerance, bias_notes, mode_tolerance, rotor_tolerance
from satid_gym.identification.variation.steps_and_drift import Variation, variation
from satid_gym.resolution import SatelliteLike, resolve_satellites
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log
from satid_gym.telemetry.units import option_of

INFLATION_MIN = 1.1  # below it there is no word of it
_ALONE = "only one window: the interval is that of the formal covariance alone"


@dataclass(frozen=True, eq=False, kw_only=True)
class Identification:
    """Inertia of a satellite from recorded flights, body frame; NaN where the data do not identify it.

    Attributes:
        satellite: nominal, with the wheels that the momentum is computed with.
        inertia: (3, 3) kg m^2, wheels locked.
        covariance: (6, 6) of Jxx, Jyy, Jzz, Jxy, Jxz, Jyz, (kg m^2)^2: noise, inflated by the scatter of residuals,
            windows and flights, and the data sheet's tolerances of gyro and wheels.
        over_rotor: (3, 3) inertia over the first wheel's rotor inertia, the only observable ratio.
        over_rotor_covariance: (6, 6) covariance of that ratio.
        parameters: the six, the delays of the time stamps of wheel speeds and attitude relative to the gyro, the
            gyro's scale where an attitude tells of it, what the data sheet does not know exactly of panels and tanks,
            and the rotors' inertia where their motors' torque was recorded.
        flights: contribution of each flight.
        inflation: factor on the formal standard deviations.
        scatter: variance between windows, and between flights, over what white noise gives.
        whiteness: whiteness of the residuals.
        jitter: s, scatter of the time stamps of one channel relative to another.
        notes: findings, one line each.
        variation: inertia over time, if requested; everything else assumes a constant inertia.
    """

    satellite: Satellite
    inertia: np.ndarray
    covariance: np.ndarray
    over_rotor: np.ndarray
    over_rotor_covariance: np.ndarray
    parameters: tuple[Parameter, ...]
    flights: tuple[FlightReport, ...]
    inflation: float
    scatter: tuple[float, float]
    whiteness: Whiteness
    jitter: float
    notes: tuple[str, ...]
    variation: Variation | None = None


def identify(
    logs: Log | Sequence[Log], satellite: SatelliteLike, *, window: float = 40.0, varying: bool = False
) -> Identification:
    """Inertia tensor from recorded gyro and wheel speeds, of one flight or several.

    The momentum of body and wheels is balanced in windows of 40 s, each with its own momentum and linear torque, in the
    inertial frame; see `satid_gym.identification.rows`. Attitude is used where a log has it, else the gyro is
    integrated between gaps. Outliers get less weight, delays between the channels are estimated, and the covariance is
    inflated by the scatter of residuals, windows and flights.

    Args:
        logs: of `read_log` or `read_logs`.
        satellite: name, file, mapping or `Satellite`: its actual wheels, and a nominal inertia, which helps to find
            wrong units and does not enter the estimate.
        window: s.
        varying: whether to test also how the inertia varies over time; see
            `satid_gym.identification.variation.steps_and_drift`.

    Raises:
        NotIdentifiedError: the logs identify none of the moments of inertia; the message says why.
        SlipError: units, signs, axes or quaternions contradict the satellite; the message names the slip.
        ValueError: the number of wheels does not match, a flight is there twice, or an argument is not valid.
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    found = resolve_satellites(satellite)
    if len(found) != 1 or not logs:
        raise ValueError(f"identify takes logs of one satellite, got {len(logs)} logs and {len(found)} satellites")
    (own,), window = found, check_number("window", window, strict=True)
    for log in logs:
        if log.wheel_speed.shape[1] != own.wheels.count:
            raise ValueError(
                f"{log.name} has {log.wheel_speed.shape[1]} wheel speeds where satellite {own.name} has "
                f"{own.wheels.count} wheels; name the columns of its wheels, or its wheels' axes"
            )
    _check_distinct(logs)
    sizes = theta_sizes(own)
    _check_windows(logs, window)
    logs, faults = without_spikes(without_saturated(logs, own), own)
    check_motion(logs, own)
    logs = check_attitude(logs)
    nominal, body, estimated = own, None, None
    with contextlib.suppress(NotIdentifiedError):
        body = flexible(logs, own, window)
        estimated = estimate(logs, body.satellite, window)
    doubt = check_fit(logs, own.replace(oscillators=()), window, sizes, estimated)
    assert body is not None
    assert estimated is not None  # check_fit has raised
    own = body.satellite
    if found_by_fit := tachometer_faults(estimated, own.wheels):
        logs, faults = without_faults(logs, found_by_fit), [*faults, *found_by_fit]
        estimated = estimate(logs, own, window)
    straight = estimate(logs, own, window, straight=True).fit.theta
    without = folds(logs, own, window)
    fit = estimated.fit
    covariance, inflation = inflated_covariance(
        fit, list(without.values()) if len(logs) > 1 else [], fit.theta - straight
    )
    known = determined(fit, covariance, sizes, own.gyro_noise_std)
    if not known[:3].any():
        raise NotIdentifiedError(with_notes(_nothing(fit, covariance, sizes, own), logs))
    theta = nearest_physical(fit.theta, np.linalg.inv(covariance)) if known.all() else fit.theta.copy()
    theta[~known] = np.nan
    covariance[~known] = covariance[:, ~known] = np.nan
    delays = delays_of(logs, estimated, inflation)
    rotors = rotor_inertias(logs, own, window)
    gyro = gyro_scale(logs, estimated.delays[:, 1])
    white = whiteness(fit)
    notes = [
        *([f"the data do not identify {_names(~known)}: the motion about these axes is too small"] * (not known.all())),
        *([doubt] if doubt else []),
        *delay_notes(logs, delays),
        *([f"residuals are not white: {white.autocorrelation:+.2f} from one reading to the next"] * (not white.white)),
        *([_ALONE] * (len(estimated.windows) == 1)),
        *([f"formal standard deviations are inflated by {inflation:.2g}"] * (inflation > INFLATION_MIN)),
        *rotor_notes(rotors, own),
        *gyro.notes(own),
        *bias_notes(logs, estimated, own),
        *body.notes(),
        *fault_notes(logs, faults),
        *reading_notes(logs),
    ]
    rotor = own.wheels.inertia[0]
    aligned = alignment_tolerance(logs, own, window, estimated, gyro.contradiction(own))
    aligned += mode_tolerance(logs, body.moved(), window, estimated)
    tolerance = rotor_tolerance(logs, own, window, estimated) + aligned
    by_motors = contradicted(rotors, own) * theta
    whole = covariance + tolerance + np.outer(by_motors, by_motors)
    varied = None
    if varying:
        apart = fit.theta - straight
        varied = variation(logs, own, window, estimated, whole, np.outer(apart, apart) + tolerance)
        notes += _variation_notes(varied, logs)
    inertia, std = inertia_tensors(theta), np.sqrt(np.diag(whole))
    moments = (Parameter(name=n, value=float(v), std=float(s)) for n, v, s in zip(NAMES, theta, std, strict=True))
    return Identification(
        satellite=nominal,
        inertia=inertia,
        covariance=whole,
        over_rotor=inertia / rotor,
        over_rotor_covariance=(covariance + aligned) / rotor**2,
        parameters=(*moments, *delays, *gyro.parameters(), *body.parameters(), *rotors),
        flights=tuple(flight_reports(logs, own, window, estimated, without, faults)),
        inflation=inflation,
        scatter=scatter(fit),
        whiteness=white,
        jitter=fit.jitter,
        notes=tuple(notes),
        variation=varied,
    )


def _variation_notes(varied: Variation, logs: Sequence[Log]) -> list[str]:
    """Notes for the reader of a variation."""
    if varied.kind == "not told":
        return ["the inertia over time is not identified: the logs are too short, or move too little"]
    return [
        f"{logs[flight].name}: the balance of momentum fails at {time:.10g} s as no satellite's inertia can make it (a "
        "long rest, or a fault of a sensor or its stamps): the inertia over time is not identified"
        for flight, time in varied.doubted
    ]


def _names(which: np.ndarray) -> str:
    return ", ".join(name for name, here in zip(NAMES, which, strict=True) if here)


def _nothing(fit: Fit, covariance: np.ndarray, sizes: np.ndarray, satellite: Satellite) -> str:
    std = np.sqrt(np.diag(covariance)) / sizes
    found = [f"{NAMES[i]} has a standard deviation of {std[i]:.2g} and {fit.signal[i]:.2g} rad/s" for i in range(3)]
    return (
        f"the logs do not identify the inertia: {', '.join(found)} of signal; expected less than {STD_MAX} of the "
        f"nominal size and more than {SIGNAL_MIN * satellite.gyro_noise_std:.2g} rad/s: turn more"
    )


def _check_distinct(logs: Sequence[Log]) -> None:
    """Refuse the same readings twice: they would count as twice as many."""
    for i, log in enumerate(logs):
        for other in logs[:i]:
            if len(log) == len(other) and np.array_equal(log.rate, other.rate, equal_nan=True):
                raise ValueError(f"{other.name} and {log.name} hold the same readings: give each flight once")


def _check_windows(logs: Sequence[Log], window: float) -> None:
    """Refuse windows longer than every log.

    Raises:
        ValueError: readings are too far apart, or their stamps are in another unit.
    """
    interval = min(log.interval for log in logs)
    if ROWS_MIN * interval > window:
        raise ValueError(
            f"readings are {interval:.3g} s apart, so a window of {window:g} s holds fewer than {ROWS_MIN}: if the "
            f"stamps are in ms, us or ns, say so, {option_of({'time': 'ms'})}; else give a window of "
            f"{10.0 * interval:.3g} s or more"
        )
