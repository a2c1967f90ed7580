"""Scale of the gyro by the attitude: over stretches of a log the gyro turns as far as the attitude does.

From attitude q0 to q1 the gyro, integrated to G, is off by e = log(G^-1 q0^-1 q1), body frame at the end. With scale
errors s about each axis and a bias b, to first order and with C(t) the rotation from the body at t to that at the end,

    e = - integral of C(t) (s * omega + b) dt

A stretch's two attitudes have noise of their own; its size, and that of what else is left out, is taken from what the
fit leaves, with stretches that stand out counted less.
Source: as in any calibration by known turns; Titterton and Weston, Strapdown Inertial Navigation Technology, ch. 8.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from satid_gym.estimators.least_squares import attitudes_after
from satid_gym.identification.delays import Parameter
from satid_gym.satellite import Satellite
from satid_gym.telemetry.log import GAP, Log

_LENGTH = 20.0  # s of a stretch, at least
_ROWS = 8  # of a stretch, at least
_STRETCHES = 10  # in all, below which the scale is not told
_FLIGHTS = 3  # from which on they are left out one at a time, too
_TOLD = 5e-3  # standard deviation of the scale about an axis, above which no scale is told
_FINE = 4  # instants of the integration between two readings
_TURNS = 4  # of the fit, each at the scale that the last has found
_SURE = 4.0  # standard deviations from which on the data sheet is contradicted
_SMALLEST, _LARGEST = 1e-3, 0.5  # that is worth a word, and that can be the gyro's


@dataclass(frozen=True, eq=False)
class GyroScale:
    """Errors (3,) of the gyro's scale about the body's axes, what it reads over what is so less 1, and their std.

    NaN and infinity where the logs do not tell of all three: no attitude, a poor one, or hardly any turn.
    """

    error: np.ndarray
    std: np.ndarray

    def contradiction(self, satellite: Satellite) -> np.ndarray:
        """The errors (3,) where one of them is beyond the data sheet's tolerance; else zeros."""
        tolerance = satellite.tolerances.gyro_scale
        beyond = np.abs(self.error) > np.maximum(_SURE * np.hypot(self.std, tolerance), _SMALLEST)
        return self.error if beyond.any() else np.zeros(3)

    def parameters(self) -> list[Parameter]:
        """What the gyro reads over what is so, about each axis; empty where nothing tells."""
        return [
            Parameter(name=f"gyro reading over rate about {axis}", value=1.0 + float(error), std=float(std), unit="1")
            for axis, error, std in zip("xyz", self.error, self.std, strict=True)
            if np.isfinite(error)
        ]

    def notes(self, satellite: Satellite) -> list[str]:
        """A line where they contradict the data sheet."""
        if not self.contradiction(satellite).any():
            return []
        found = ", ".join(
            f"{100.0 * error:+.2g} +- {100.0 * std:.1g} % about {axis}"
            for error, std, axis in zip(self.error, self.std, "xyz", strict=True)
        )
        return [
            f"by the attitude the gyro's scale is off by {found}, where the data sheet's tolerance is "
            f"{100.0 * satellite.tolerances.gyro_scale:.2g} %: the intervals are wide enough for that; for narrower "
            "ones divide its columns by one plus these errors"
        ]


def corrected(logs: Sequence[Log], error: np.ndarray) -> list[Log]:
    """Logs of a gyro without these scale errors (3,)."""
    return [replace(log, rate=log.rate / (1.0 + error)) for log in logs]


def gyro_scale(logs: Sequence[Log], delays: np.ndarray) -> GyroScale:
    """Scale of the gyro that flew in all logs; each has a bias of its own.

    Args:
        logs: one a flight; those without attitude tell nothing.
        delays: (F,) s by which the attitude's stamps are late against the gyro's.
    """
    unknown = GyroScale(np.full(3, np.nan), np.full(3, np.inf))
    error, noise = np.zeros(3), np.inf
    for _ in range(_TURNS):
        rows, targets, flights = _equations(corrected(logs, error), delays)
        if len(rows) < _STRETCHES:
            return unknown
        design, target = np.concatenate(rows), np.concatenate(targets)
        flown = np.asarray(np.abs(design).max(axis=0) > 0.0)
        if not flown[:3].all():
            return unknown
        size = np.linalg.norm(design[:, flown], axis=0)
        scaled = design[:, flown] / size
        found, noise = _robust(scaled, target, noise)
        error = (1.0 + error) * (1.0 + found[:3] / size[:3]) - 1.0
        if np.abs(error).max() > _LARGEST:
            return unknown
    weight = 1.0 / np.sqrt(1.0 + ((target - scaled @ found) / noise) ** 2)
    matrices, vectors = _normal(scaled, weight, target)
    alone = _jackknife(matrices, vectors)
    if len(set(flights)) >= _FLIGHTS:  # attitudes may be off alike within a flight
        groups = [np.array(flights) == one for one in sorted(set(flights))]
        together = [np.array([part[g].sum(axis=0) for g in groups]) for part in (matrices, vectors)]
        alone = np.maximum(alone, _jackknife(*together))
    std = alone / size[:3]
    return GyroScale(error, std) if std.max() < _TOLD else unknown


def _normal(design: np.ndarray, weight: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and vector of the normal equations of each stretch of three rows."""
    blocks = design.reshape(-1, 3, design.shape[1])
    weighted = weight.reshape(-1, 3, 1) * blocks
    return np.einsum("kri,krj->kij", weighted, blocks), np.einsum("kri,kr->ki", weighted, target.reshape(-1, 3))


def _jackknife(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Standard deviations of the first three unknowns, by leaving out one of the normal equations' parts at a time."""
    total, right = matrices.sum(axis=0), vectors.sum(axis=0)
    without = np.array([np.linalg.pinv(total - m) @ (right - v) for m, v in zip(matrices, vectors, strict=True)])
    return np.asarray(np.sqrt(len(without) - 1) * without[:, :3].std(axis=0))


def _robust(design: np.ndarray, target: np.ndarray, noise: float) -> tuple[np.ndarray, float]:
    """Solution in which what is beyond the noise (infinite: not known) counts less, and the noise by what is left."""
    found = np.linalg.lstsq(design, target, rcond=None)[0]
    if np.isfinite(noise):
        found = least_squares(lambda x: design @ x - target, found, loss="soft_l1", f_scale=noise).x
    return found, max(2.0 * 1.4826 * float(np.median(np.abs(target - design @ found))), 1e-12)


def _equations(logs: Sequence[Log], delays: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray], list[int]]:
    """Derivatives (3, 3 + 3 F) by the scale and each flight's bias, error (3,), and flight of each stretch."""
    rows, targets, flights = [], [], []
    for number, (log, delay) in enumerate(zip(logs, delays, strict=True)):
        for scale, bias, error in _stretches(log, delay):
            row = np.zeros((3, 3 + 3 * len(logs)))
            row[:, :3], row[:, 3 + 3 * number : 6 + 3 * number] = scale, bias
            rows.append(row)
            targets.append(error)
            flights.append(number)
    return rows, targets, flights


def _stretches(log: Log, delay: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Derivatives (3, 3) by scale and bias, and error (3,), rad, of each stretch between two attitudes of a log."""
    if log.attitude is None:
        return []
    index = np.flatnonzero(np.isfinite(log.rate).all(axis=1))
    found = []
    for part in np.split(index, np.flatnonzero(np.diff(log.time[index]) > GAP * log.interval) + 1):
        if len(part) < _ROWS:
            continue
        time = log.time[part]
        rate = make_interp_spline(time, log.rate[part], k=3)
        seen = part[np.isfinite(log.attitude[part]).all(axis=1)]
        seen = seen[(log.time[seen] - delay >= time[0]) & (log.time[seen] - delay <= time[-1])]
        start = 0
        for end in range(1, len(seen)):
            if log.time[seen[end]] - log.time[seen[start]] >= max(_LENGTH, _ROWS * log.interval):
                first, last = log.time[seen[[start, end]]] - delay
                turn = Rotation.from_quat(log.attitude[seen[[start, end]]])
                found.append(_stretch(rate, first, last, log.interval, turn[0].inv() * turn[1]))
                start = end
    return found


def _stretch(
    rate: Callable[[np.ndarray], np.ndarray], first: float, last: float, interval: float, turn: Rotation
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives by scale and bias, and error, of the gyro's turn from first to last against the attitude's."""
    steps = int(np.ceil(_FINE * (last - first) / interval))
    h = (last - first) / steps
    omega = rate(first + h * (np.arange(steps) + 0.5))
    attitude = attitudes_after(np.repeat(0.5 * h * omega, 2, axis=0))
    undone = attitude[-1].T
    back = undone @ attitude[1::2]  # from the body in the middle of a step to that at the end
    error = (Rotation.from_matrix(undone) * turn).as_rotvec()
    return -h * np.einsum("kij,kj->ij", back, omega), -h * back.sum(axis=0), error
