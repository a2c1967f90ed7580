"""Inertia of the rotors from motor torque, if a log has it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.identification.delays import Parameter
from satid_gym.identification.slips.checks import SlipError
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log
from satid_gym.telemetry.log import GAP
from satid_gym.telemetry.units import option_of, turned_unit

_ROWS_MIN = 8  # of a window
_WINDOWS_MIN = 3  # whose scatter says how far to trust the mean
_TOLD = 0.25  # of the data sheet's: with a larger standard deviation the motors say nothing of it
_STDS, _SHARE = 3.0, 0.02  # by which motors contradict the data sheet


def rotor_inertias(logs: Sequence[Log], satellite: Satellite, window: float) -> list[Parameter]:
    """Inertia of each rotor, kg m^2, from j (dOmega/dt + a . domega/dt) = torque - friction, integrated over windows.

    Friction has a part by the sign of the speed and one that goes with it. Logs without `motor_torque` give none; NaN
    where the motors do not tell it.

    Raises:
        SlipError: torque and speed have opposite signs.
    """
    found: list[Parameter] = []
    if all(log.motor_torque is None for log in logs):
        return found
    units = {"motor_torque": "Nm", **logs[0].units}
    for k in range(satellite.wheels.count):
        pieces = [piece for log in logs for piece in _pieces(log, satellite.wheels.axes[:, k], k, window)]
        value, std = _ratio(pieces)
        if value + _STDS * std < 0.0:
            raise SlipError(
                f"motor_torque of wheel {k + 1} and its speed have opposite signs, expected the torque on the wheel: "
                f"give {option_of({'motor_torque': turned_unit(units, 'motor_torque')})}, or negate its column"
            )
        if not std < _TOLD * satellite.wheels.inertia[k]:
            value, std = np.nan, np.nan
        found.append(Parameter(name=f"rotor inertia of wheel {k + 1}", value=value, std=std))
    return found


def contradicted(rotors: Sequence[Parameter], satellite: Satellite) -> float:
    """By how much of itself the tensor is off if the motors are right and the data sheet is wrong; 0 if they agree."""
    pairs = zip(rotors, satellite.wheels.inertia, strict=False)
    off = [rotor.value / sheet - 1.0 if _contradicts(rotor, sheet) else 0.0 for rotor, sheet in pairs]
    return float(np.mean(off)) if off else 0.0


def _contradicts(rotor: Parameter, sheet: float) -> bool:
    return rotor.determined and abs(rotor.value - sheet) > max(_STDS * rotor.std, _SHARE * sheet)


def rotor_notes(rotors: Sequence[Parameter], satellite: Satellite) -> list[str]:
    """A line for each rotor whose motor contradicts the data sheet."""
    return [
        f"{rotor.name} is {rotor.value:.4g} +- {rotor.std:.1g} kg m^2 by its motor's torque, and {sheet:.4g} in the "
        "data sheet, with which the inertia tensor scales: the intervals are wide enough for both"
        for rotor, sheet in zip(rotors, satellite.wheels.inertia, strict=False)
        if _contradicts(rotor, sheet)
    ]


def _pieces(log: Log, axis: np.ndarray, k: int, window: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Design (N, 3), spin and friction, and impulse (N,) of each stretch of a window, without their means."""
    if log.motor_torque is None:
        return []
    speed, torque = log.wheel_speed[:, k], log.motor_torque[:, k]
    good = np.flatnonzero(np.isfinite(speed) & np.isfinite(torque) & np.isfinite(log.rate).all(axis=1))
    time = log.time[good]
    edges = np.flatnonzero(
        (np.diff(time) > GAP * log.interval) | (np.diff(np.floor((time - log.time[0]) / window)) > 0)
    )
    found = []
    for rows in np.split(good, edges + 1):
        if len(rows) < _ROWS_MIN:
            continue
        step = np.diff(log.time[rows])
        spin = speed[rows] + log.rate[rows] @ axis
        friction = np.column_stack([_between(step, part) for part in (np.sign(speed[rows]), speed[rows])])
        columns, impulse = np.column_stack([spin, friction]), _held(step, torque[rows])
        found.append((columns - columns.mean(axis=0), impulse - impulse.mean()))
    return found


def _held(step: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral (N,) of values that are held until the next reading."""
    return np.concatenate([[0.0], np.cumsum(step * values[:-1])])


def _between(step: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral (N,) of values that run on straight lines from reading to reading."""
    return np.concatenate([[0.0], np.cumsum(step * 0.5 * (values[1:] + values[:-1]))])


def _ratio(pieces: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Inertia and its standard deviation by leaving out one piece at a time; NaN where there are too few."""
    if len(pieces) < _WINDOWS_MIN:
        return np.nan, np.nan
    matrices = np.array([design.T @ design for design, _ in pieces])
    vectors = np.array([design.T @ target for design, target in pieces])
    total, right = matrices.sum(axis=0), vectors.sum(axis=0)
    size = np.sqrt(np.maximum(np.diag(total), 1e-300))

    def solved(matrix: np.ndarray, vector: np.ndarray) -> float:
        return float((np.linalg.pinv(matrix / np.outer(size, size), rcond=1e-10) @ (vector / size))[0] / size[0])

    without = np.array([solved(total - m, right - v) for m, v in zip(matrices, vectors, strict=True)])
    count = len(pieces)
    return solved(total, right), float(np.sqrt((count - 1) * without.var()))
