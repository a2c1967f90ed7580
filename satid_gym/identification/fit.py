"""Fit of the momentum balance: instrumental variables with robust weights, and noise that the residuals give.

The noise of a row is sigma_i^2 + s^2 m_i^2: one part by body axis, and one that goes with how fast the momentum's
parts move, m, for stamps that are not exact. Both are found from the residuals, and Tukey's bisquare weighs instants.
Noise of gyro and stamps in L(omega) would pull theta toward zero, so rows are weighed with the L of the neighbouring
readings, which share the motion: Z^T (X theta - y) = 0 has no such pull where neighbours share no noise; interpolation
between slow readings leaves a part.
Source: Huber, Robust Statistics (1981), ch. 7; Soderstrom, Automatica 43(6), 2007 (instrumental variables).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from satid_gym.identification.rows import Window

BISQUARE = 6.0  # distance of an instant's three residuals at which its weight is 0; that of pure noise is 1.5
_ROUNDS = 12
_QUIET = 0.01  # an axis that always reads the same is believed this share of the noisiest one's noise
_FLAT = 100.0  # sizes of theta: standard deviation of a prior that only keeps the equations solvable
_MEDIAN_SQUARE = 0.4549  # of a standard normal variable


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightShare:
    """Contribution of a flight, with its own unknowns eliminated.

    Attributes:
        information: (6, 6) about theta, 1 / (kg m^2)^2.
        scores: (W, 6) of each window at the estimate, 1 / (kg m^2).
        expected: (W, 6, 6) covariance of the scores if the noise is white and as large as found.
        told: of each window, (N, 6) what each instant adds to the diagonal of `expected`.
        common: (m,) gyro bias g, rad/s, torque b, N m, and delays, s.
        common_std: (m,) formal standard deviations.
    """

    information: np.ndarray
    scores: np.ndarray
    expected: np.ndarray
    told: list[np.ndarray]
    common: np.ndarray
    common_std: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """Estimate with all that is needed to judge it.

    Attributes:
        theta: (6,) kg m^2.
        covariance: (6, 6) formal, for white noise.
        signal: (6,) rms of each parameter's own part of the regressor, rad/s.
        unexplained: rms of the weighted residuals over that of what theta has to explain.
        flights: each flight's share.
        residuals: of each window, (N, 3) N m s.
        normal: of each window, (N, 3) residuals over their standard deviation.
        weights: of each window, (N,).
        sigma: (3,) N m s, noise by body axis.
        jitter: s, the noise of stamps.
    """

    theta: np.ndarray
    covariance: np.ndarray
    signal: np.ndarray
    unexplained: float
    flights: list[FlightShare]
    residuals: list[np.ndarray]
    normal: list[np.ndarray]
    weights: list[np.ndarray]
    sigma: np.ndarray
    jitter: float


class Rows(NamedTuple):
    """A window in units of noise, with its own unknowns projected out."""

    design: np.ndarray  # (3 N, 6 + m)
    instruments: np.ndarray  # (3 N, 6 + m)
    target: np.ndarray  # (3 N,)


def fit(
    windows: Sequence[Window], scale: np.ndarray, common_std: np.ndarray, *, given: np.ndarray | None = None
) -> Fit:
    """Theta and its covariance from windows of one flight or several.

    Args:
        windows: of all flights, in order of the flights.
        scale: (6,) sizes of theta, kg m^2.
        common_std: (m,) prior standard deviations of g, of b and of the delays.
        given: (6,) theta that is taken as it is, to see how well it predicts; None: it is estimated.
    """
    weights = [np.ones(len(window)) for window in windows]
    sigma, jitter = first_noise(windows), 0.0
    for _ in range(_ROUNDS):
        std = row_stds(windows, sigma, jitter)
        ready = [projected_rows(w, s, weight) for w, s, weight in zip(windows, std, weights, strict=True)]
        theta, covariance, shares = solve(windows, ready, scale, common_std, given)
        residuals = [
            residual_of(window, s, weight, theta, shares[window.flight].common)
            for window, s, weight in zip(windows, std, weights, strict=True)
        ]
        sigma, jitter = noise_of(windows, residuals)
        std = row_stds(windows, sigma, jitter)
        normal = [residual / s for residual, s in zip(residuals, std, strict=True)]
        before, weights = weights, [bisquare(rows) for rows in normal]
        if max(np.abs(new - old).max() for new, old in zip(weights, before, strict=True)) < 1e-3:
            break
    signal, unexplained = _signal(windows, weights, residuals)
    return Fit(
        theta=theta,
        covariance=covariance,
        signal=signal,
        unexplained=unexplained,
        flights=[shares[number] for number in sorted(shares)],
        residuals=residuals,
        normal=normal,
        weights=weights,
        sigma=sigma,
        jitter=jitter,
    )


def row_stds(windows: Sequence[Window], sigma: np.ndarray, jitter: float) -> list[np.ndarray]:
    """Standard deviations (N, 3) of each window's rows, N m s."""
    return [np.sqrt(sigma**2 + (jitter * window.motion) ** 2) for window in windows]


def projected(window: Window, std: np.ndarray, weight: np.ndarray, *parts: np.ndarray) -> list[np.ndarray]:
    """Parts (N, 3, k) of a window's rows as (3 N, k) in units of noise, without what the window has for itself."""
    root = (np.sqrt(weight)[:, None] / std)[..., None]
    own, *rows = ((part * root).reshape(3 * len(window), -1) for part in (window.own, *parts))
    basis, values, _ = np.linalg.svd(own, full_matrices=False)
    basis = basis[:, values > 1e-9 * values[0]]
    return [part - basis @ (basis.T @ part) for part in rows]


def projected_rows(window: Window, std: np.ndarray, weight: np.ndarray) -> Rows:
    """Rows of a window with a weight (N,) for each instant."""
    parts = (window.regressor, window.common, window.instrument, window.target[..., None])
    design, common, instrument, target = projected(window, std, weight, *parts)
    return Rows(np.hstack([design, common]), np.hstack([instrument, common]), target[:, 0])


def solve(
    windows: Sequence[Window], ready: list[Rows], scale: np.ndarray, common_std: np.ndarray, given: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, dict[int, FlightShare]]:
    """Theta, its covariance, and the flights' shares."""
    flights = sorted({window.flight for window in windows})
    mine = {f: [r for w, r in zip(windows, ready, strict=True) if w.flight == f] for f in flights}
    normal, rights, eliminations = {}, {}, {}
    total, right = np.diag(1.0 / (_FLAT * scale) ** 2), np.zeros(6)
    for f, parts in mine.items():
        m = parts[0].design.shape[1] - 6
        matrix = sum(part.instruments.T @ part.design for part in parts)
        matrix[6:, 6:] += np.diag(1.0 / common_std[:m] ** 2)
        vector = sum(part.instruments.T @ part.target for part in parts)
        normal[f], rights[f] = matrix, vector
        eliminations[f] = np.linalg.solve(matrix[6:, 6:].T, matrix[:6, 6:].T)  # what makes instruments blind to common
        total = total + matrix[:6, :6] - eliminations[f].T @ matrix[6:, :6]
        right = right + vector[:6] - eliminations[f].T @ vector[6:]
    theta = np.linalg.solve(total, right) if given is None else given
    shares, spread = {}, np.zeros((6, 6))
    for f, parts in mine.items():
        matrix, elimination = normal[f], eliminations[f]
        common = np.linalg.solve(matrix[6:, 6:], rights[f][6:] - matrix[6:, :6] @ theta)
        unknown = np.concatenate([theta, common])
        blind = [part.instruments[:, :6] - part.instruments[:, 6:] @ elimination for part in parts]
        expected = np.array([z.T @ z for z in blind])
        spread = spread + expected.sum(axis=0)
        information = matrix[:6, :6] - elimination.T @ matrix[6:, :6]
        shares[f] = FlightShare(
            information=0.5 * (information + information.T),
            scores=np.array([z.T @ (p.target - p.design @ unknown) for z, p in zip(blind, parts, strict=True)]),
            expected=expected,
            told=[(z**2).reshape(-1, 3, 6).sum(axis=1) for z in blind],
            common=common,
            common_std=np.sqrt(np.abs(np.diag(np.linalg.pinv(matrix))[6:])),
        )
    inverse = np.linalg.inv(total)
    flat = np.diag(1.0 / (_FLAT * scale) ** 2)
    return theta, inverse @ (spread + flat) @ inverse.T, shares


def residual_of(
    window: Window, std: np.ndarray, weight: np.ndarray, theta: np.ndarray, common: np.ndarray
) -> np.ndarray:
    """(N, 3) N m s with theta (6,), or (N, 6) of each row, after the window's own unknowns have taken what they can."""
    known = np.broadcast_to(theta, (len(window), 6))
    rest = window.target - np.einsum("nip,np->ni", window.regressor, known) - window.common @ common
    root = (np.sqrt(weight)[:, None] / std)[..., None]
    design = (window.own * root).reshape(3 * len(window), -1)
    own = np.linalg.lstsq(design, (rest * root[..., 0]).ravel(), rcond=1e-9)[0]
    return rest - window.own @ own


def first_noise(windows: Sequence[Window]) -> np.ndarray:
    """(3,) of the target's changes from row to row, as a start."""
    steps = np.concatenate([np.diff(window.target, axis=0) for window in windows])
    return np.maximum(1.4826 * np.median(np.abs(steps), axis=0), 1e-3 * np.abs(steps).max() + 1e-300)


def noise_of(windows: Sequence[Window], residuals: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Noise by axis from the calmer half of the rows, and that of the stamps from the other half."""
    rest, motion = np.concatenate(residuals), np.concatenate([window.motion for window in windows])
    freedom = 3.0 * len(rest) / max(3.0 * len(rest) - windows[0].own.shape[2] * len(windows) - 11.0, 1.0)
    calm = motion <= np.median(motion, axis=0)
    sigma = np.array([np.median(rest[calm[:, i], i] ** 2) for i in range(3)]) / _MEDIAN_SQUARE * freedom
    sigma = np.sqrt(np.maximum(sigma, _QUIET**2 * sigma.max() + 1e-12 * (rest**2).max() + 1e-300))
    square, rate = (rest**2)[~calm] * freedom, (motion**2)[~calm]
    base = np.broadcast_to(sigma**2, rest.shape)[~calm]
    low, high = 0.0, float(np.sqrt((square / np.maximum(rate, 1e-300)).max()))
    for _ in range(60):
        middle = 0.5 * (low + high)
        if np.median(square / (base + middle**2 * rate)) > _MEDIAN_SQUARE:
            low = middle
        else:
            high = middle
    return sigma, low


def bisquare(normal: np.ndarray) -> np.ndarray:
    """Weights (N,) of instants by the length of their three residuals."""
    share = (normal**2).sum(axis=1) / BISQUARE**2
    return np.clip(1.0 - share, 0.0, None) ** 2


def _signal(
    windows: Sequence[Window], weights: list[np.ndarray], residuals: list[np.ndarray]
) -> tuple[np.ndarray, float]:
    """Rms (6,) of each parameter's own part of the regressor, rad/s, and the share of the target left unexplained."""
    matrix, target, left = np.zeros((6, 6)), 0.0, 0.0
    for window, weight, residual in zip(windows, weights, residuals, strict=True):
        root = np.repeat(np.sqrt(weight), 3)[:, None]
        basis, values, _ = np.linalg.svd(root * window.own.reshape(3 * len(window), -1), full_matrices=False)
        basis = basis[:, values > 1e-9 * values[0]]
        rows = np.concatenate([window.regressor, window.target[..., None]], axis=2).reshape(-1, 7) * root
        rows = rows - basis @ (basis.T @ rows)
        matrix += rows[:, :6].T @ rows[:, :6]
        target, left = target + float(rows[:, 6] @ rows[:, 6]), left + float((weight @ residual**2).sum())
    count = sum(map(len, windows))
    floor = 1e-12 * max(np.trace(matrix), 1e-300)
    own = 1.0 / np.diag(np.linalg.inv(matrix + floor * np.eye(6)))
    return np.sqrt(own / count), float(np.sqrt(left / max(target, 1e-300)))
