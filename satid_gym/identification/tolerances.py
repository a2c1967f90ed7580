"""Data sheet and estimate: what its tolerances add to the uncertainty, and notes on what contradicts it or is left out.

No log tells of the scale and alignment of the wheels, nor, without an attitude, of the gyro's.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from satid_gym.identification.estimate import Estimated, estimate
from satid_gym.identification.gyro_scale import corrected
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_BIAS_STDS = 5.0  # beyond which a bias contradicts the data sheet
Case = tuple[Sequence[Log], Satellite]


def rotor_tolerance(logs: Sequence[Log], satellite: Satellite, window: float, estimated: Estimated) -> np.ndarray:
    """Covariance (6, 6) of theta by the tolerance of each rotor's inertia."""
    wheels, tolerance = satellite.wheels, satellite.tolerances.wheel_inertia
    off = tolerance * np.eye(wheels.count) if tolerance > 0.0 else ()
    built = (satellite.replace(wheels=wheels.replace(inertia=wheels.inertia * (1.0 + one))) for one in off)
    return _covariance(((logs, one) for one in built), window, estimated)


def alignment_tolerance(
    logs: Sequence[Log], satellite: Satellite, window: float, estimated: Estimated, off: np.ndarray
) -> np.ndarray:
    """Covariance (6, 6) of theta by the tolerances of the gyro's scale and alignment and of the wheels' alignment.

    off: errors (3,) of the gyro's scale that contradict its tolerance, of which the whole move counts; 0 without.
    """
    found_off = [corrected(logs, off)] if off.any() else []
    gyro = ((logs_off, satellite) for logs_off in (*_gyros(logs, satellite), *found_off))
    wheels = ((logs, one) for one in _tilted(satellite))
    return _covariance(itertools.chain(gyro, wheels), window, estimated)


def mode_tolerance(logs: Sequence[Log], moved: Iterable[Satellite], window: float, estimated: Estimated) -> np.ndarray:
    """Covariance (6, 6) of theta by what is not known of panels and tanks, of satellites `moved` by that."""
    return _covariance(((logs, one) for one in moved), window, estimated)


def _covariance(cases: Iterable[Case], window: float, estimated: Estimated) -> np.ndarray:
    """Sum of the outer products of theta's moves, one for each case with one error of a standard deviation."""
    found = np.zeros((6, 6))
    for logs, satellite in cases:
        move = estimate(logs, satellite, window).fit.theta - estimated.fit.theta
        found += np.outer(move, move)
    return found


def _gyros(logs: Sequence[Log], satellite: Satellite) -> Iterator[list[Log]]:
    """Logs of a gyro with one entry of its gain off, as `satid_gym.tolerances.Tolerances` has them."""
    scale, alignment = satellite.tolerances.gyro_scale, satellite.tolerances.gyro_alignment
    for i, j in itertools.product(range(3), range(3)):
        std = scale if i == j else alignment
        if std > 0.0:
            gain = np.eye(3)
            gain[i, j] += std
            yield [replace(log, rate=log.rate @ gain.T) for log in logs]


def _tilted(satellite: Satellite) -> Iterator[Satellite]:
    """The satellite with one wheel's axis tilted, in each of the two directions across it."""
    wheels, std = satellite.wheels, satellite.tolerances.wheel_alignment
    if std == 0.0:
        return
    for k in range(wheels.count):
        _, _, directions = np.linalg.svd(wheels.axes[:, k][None])
        for across in directions[1:]:
            axes = wheels.axes.copy()
            axes[:, k] += std * across
            axes[:, k] /= np.linalg.norm(axes[:, k])
            yield satellite.replace(wheels=wheels.replace(axes=axes))


def bias_notes(logs: Sequence[Log], estimated: Estimated, satellite: Satellite) -> list[str]:
    """A line for each flight whose gyro's bias is far beyond the data sheet's tolerance."""
    tolerance = satellite.tolerances.gyro_bias
    largest = np.abs(estimated.biases).max(axis=1)
    return [
        f"{log.name}: the gyro's bias is {bias:.2g} rad/s, {bias / tolerance:.0f} times the data sheet's tolerance"
        for log, bias in zip(logs, largest, strict=True)
        if tolerance > 0.0 and bias > _BIAS_STDS * tolerance
    ]
