"""Balance of momentum with an inertia that runs from knot to knot in time.

Eliminating what windows and flights have for themselves (momentum, torque, bias, delays) leaves, for the inertias
x (6 K,) at K knots in units of their nominal sizes,

    z = B x + e,   e white with variance c >= 1,   B^T B = (Z^T X)^T (Z^T Z)^-1 (Z^T X)

which are the equations Z^T (X x - y) = 0 of `satid_gym.identification.fit` in units of their errors, Z^T Z. The scale
c is 1 if residuals are white; errors that last for longer than a reading, as those of interpolation, make it larger.
Source: Soderstrom, Automatica 43(6), 2007; Bar-Shalom, Li, Kirubarajan, Estimation with Applications (2001), ch. 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from satid_gym.estimators.batch.regression import SIGNAL_MIN
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.identification.fit import bisquare, first_noise, noise_of, projected, residual_of
from satid_gym.identification.rows import Window
from satid_gym.identification.variation.course import Course

_ROUNDS = 6
_RIDGE = 1e-9  # of the instruments' scale: keeps the equations solvable
_ENERGY_MIN = 1e-6  # of the noise's square: instruments with less say nothing
_STD_MAX = 0.3  # of nominal: directions that are known to less say nothing
_FLAT = 100.0  # of nominal: prior of what a course leaves free
_ENTRIES = np.abs(inertia_tensors(np.eye(6))).sum(axis=2)  # (6, 3): rates that each parameter takes into each row


def knots_of(
    windows: Sequence[Window], length: float, breaks: Sequence[tuple[int, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Flight (K,) and instant (K,), s, of knots about `length` apart; a break (flight, instant) has two."""
    flights, times = [], []
    for flight in sorted({window.flight for window in windows}):
        stamps = np.concatenate([window.time for window in windows if window.flight == flight])
        inner = sorted(at for number, at in breaks if number == flight and stamps.min() < at < stamps.max())
        for low, high in zip([stamps.min(), *inner], [*inner, stamps.max()], strict=True):
            times.append(np.linspace(low, high, max(1, round((high - low) / length)) + 1))
            flights.append(np.full(len(times[-1]), flight))
    return np.concatenate(flights), np.concatenate(times)


def _places(window: Window, course: Course) -> tuple[np.ndarray, np.ndarray]:
    """Knots (k,) near a window, and the weight (N, k) of each for each row: hats from knot to knot."""
    mine = np.flatnonzero(course.flight == window.flight)
    time = course.time[mine]
    left = np.clip(np.searchsorted(time, window.time, side="right") - 1, 0, len(mine) - 2)
    share = np.clip((window.time - time[left]) / (time[left + 1] - time[left]), 0.0, 1.0)
    here = np.arange(left.min(), left.max() + 2)
    weight = (left[:, None] == here) * (1.0 - share)[:, None] + (left[:, None] + 1 == here) * share[:, None]
    return mine[here], weight


@dataclass(frozen=True, eq=False, kw_only=True)
class Balance:
    """What the rows tell of the knots.

    Attributes:
        B: (r, 6 K) in units of noise.
        M: (r, 3 K) of a jump of the momentum at each knot, which a course has none of.
        z: (r,).
        common: of each flight, by its number, (m,) bias g, rad/s, torque b, N m, and delays, s.
        sigma: (3,) N m s, noise by body axis.
        jitter: s, the noise of stamps.
    """

    B: np.ndarray
    M: np.ndarray
    z: np.ndarray
    common: dict[int, np.ndarray]
    sigma: np.ndarray
    jitter: float


def balance(
    windows: Sequence[Window], course: Course, sizes: np.ndarray, common_std: np.ndarray, gyro_std: float
) -> Balance:
    """B and z of all rows, with the noise and the weights that the residuals of an inertia on this course give.

    What moves by less than three times the gyro's noise, `gyro_std`, rad/s, near a knot is no instrument there.
    """
    places = [_places(window, course) for window in windows]
    sigma, jitter = first_noise(windows), 0.0
    weights = [np.ones(len(window)) for window in windows]
    for _ in range(_ROUNDS):
        std = [np.sqrt(sigma**2 + (jitter * window.motion) ** 2) for window in windows]
        equations = _Equations(windows, places, std, weights, sizes, common_std, gyro_std, course.time)
        x, common = equations.solve(course)
        theta = x.reshape(-1, 6) * sizes
        residuals = [
            residual_of(window, s, weight, hats @ theta[here], common[window.flight])
            for window, s, weight, (here, hats) in zip(windows, std, weights, places, strict=True)
        ]
        sigma, jitter = noise_of(windows, residuals)
        weights = [
            bisquare(residual / np.sqrt(sigma**2 + (jitter * window.motion) ** 2))
            for window, residual in zip(windows, residuals, strict=True)
        ]
    B, M, z = _Equations(windows, places, std, weights, sizes, common_std, gyro_std, course.time, jumps=True).reduced()
    return Balance(B=B, M=M, z=z, common=common, sigma=sigma, jitter=jitter)


def _moving(square: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(6, 6) that keeps of instruments, given their squares (6, 6) and those of noise (6,), what moves enough."""
    if not (noise > 0.0).all():
        return np.zeros((6, 6))
    unit = np.sqrt(noise)
    values, vectors = np.linalg.eigh(square / np.outer(unit, unit))
    kept = vectors[:, values > SIGNAL_MIN**2]
    return np.asarray((kept @ kept.T) * unit / unit[:, None])


class _Equations:
    """Equations for all knots (6 K); then for what each flight has in common, and for jumps (3 K)."""

    def __init__(
        self,
        windows: Sequence[Window],
        places: list[tuple[np.ndarray, np.ndarray]],
        std: list[np.ndarray],
        weights: list[np.ndarray],
        sizes: np.ndarray,
        common_std: np.ndarray,
        gyro_std: float,
        knots: np.ndarray,
        *,
        jumps: bool = False,
    ) -> None:
        self.count, self.common_std = 6 * len(knots), common_std
        self.offset: dict[int, slice] = {}
        self.stop = self.count
        for window in windows:
            if window.flight not in self.offset:
                self.offset[window.flight] = slice(self.stop, self.stop + window.common.shape[2])
                self.stop += window.common.shape[2]
        total = self.stop + (3 * len(knots) if jumps else 0)
        momentum = np.sqrt(np.mean([np.mean(window.target**2) for window in windows]))
        cross, square, score = np.zeros((total, total)), np.zeros((total, total)), np.zeros(total)
        noise = np.zeros((len(knots), 6))
        for window, (here, hats), s, weight in zip(windows, places, std, weights, strict=True):
            X, Z = (
                (hats[:, None, :, None] * (part * sizes)[:, :, None, :]).reshape(len(window), 3, -1)
                for part in (window.regressor, window.instrument)
            )
            own = self.offset[window.flight]
            index = [np.add.outer(6 * here, np.arange(6)).ravel(), np.arange(own.start, own.stop)]
            common = window.common * self._common(window)
            if jumps:
                later = (window.time[:, None] >= knots[here])[:, None, :, None] * momentum
                common = np.dstack([common, (later * window.own[:, :, None, :3]).reshape(len(window), 3, -1)])
                index.append(self.stop + np.add.outer(3 * here, np.arange(3)).ravel())
            X, common, Z, target = projected(window, s, weight, X, common, Z, window.target[..., None])
            design, instrument = np.hstack([X, common]), np.hstack([Z, common])
            noise[here] += ((hats**2).T @ (weight[:, None] / s**2) @ _ENTRIES.T) * (gyro_std * sizes) ** 2
            block = np.ix_(np.concatenate(index), np.concatenate(index))
            cross[block] += instrument.T @ design
            square[block] += instrument.T @ instrument
            score[block[1][0]] += instrument.T @ target[:, 0]
        for k, energy in enumerate(noise):
            own = slice(6 * k, 6 * k + 6)
            told = _moving(square[own, own], energy)
            cross[own], score[own] = told.T @ cross[own], told.T @ score[own]
            square[own] = told.T @ square[own]
            square[:, own] = square[:, own] @ told
        scale = np.maximum(np.diag(square), _ENERGY_MIN)
        gain = scipy.linalg.cho_solve(scipy.linalg.cho_factor(square + np.diag(_RIDGE * scale)), cross).T
        self.score = score
        self.cross = cross
        self.A, self.b = gain @ cross, gain @ score
        for part in (self.A, self.cross):
            part[range(self.count, self.stop), range(self.count, self.stop)] += 1.0

    def _common(self, window: Window) -> np.ndarray:
        """(m,) units of what is common: the standard deviations of its prior."""
        return self.common_std[: window.common.shape[2]]

    def solve(self, course: Course) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """x (6 K,) on a course, and what each flight has in common."""
        used = slice(0, self.stop)
        spread = scipy.linalg.block_diag(course.spread, np.eye(self.stop - self.count))
        many = course.walk > 0.0  # unknowns, each told by few rows
        matrix, right = (self.A[used, used], self.b[used]) if many else (self.cross[used, used], self.score[used])
        matrix = spread.T @ matrix @ spread
        prior = np.zeros(len(matrix))
        prior[: course.free] = _FLAT**-2
        prior[course.free : course.spread.shape[1]] = 1.0
        found = spread @ np.linalg.solve(matrix + np.diag(prior), spread.T @ right)
        common = {flight: found[own] for flight, own in self.offset.items()}
        return found[: self.count], {f: part * self.common_std[: len(part)] for f, part in common.items()}

    def reduced(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """B, M and z, what the flights have in common eliminated."""
        common = np.arange(self.count, self.stop)
        left = np.setdiff1d(np.arange(len(self.A)), common)
        among = self.A[np.ix_(common, common)]
        blind = np.linalg.solve(among, self.A[np.ix_(common, left)]).T
        told = self.A[np.ix_(left, left)] - blind @ self.A[np.ix_(common, left)]
        values, vectors = np.linalg.eigh(0.5 * (told + told.T))
        keep = values > _STD_MAX**-2
        root, vectors = np.sqrt(values[keep]), vectors[:, keep]
        rows = (vectors * root).T
        return rows[:, : self.count], rows[:, self.count :], vectors.T @ (self.b[left] - blind @ self.b[common]) / root
