"""Least squares for the frequency, damping and mass of panels and tanks.

With theta and all else eliminated, the residual of the momentum balance is a function of these few unknowns. Over a
frequency it has many local minima, one for each oscillation more in a window, so a grid comes first.
Source: Golub and Pereyra, Inverse Problems 19(2), 2003 (variable projection).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.identification.estimate import Estimated, all_windows, common_stds, estimate, theta_sizes
from satid_gym.identification.fit import projected_rows, row_stds, solve
from satid_gym.identification.flexible_body.modal_momentum import with_modes
from satid_gym.identification.judgement import scatter
from satid_gym.identification.rows import Window
from satid_gym.oscillators import DAMPING_MAX, Panel
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_REACH = 4.0  # standard deviations of the data sheet that are searched
_SHORT = 6.0  # oscillations in the windows of the first, wide search
_SLIP = 0.1  # of an oscillation, in a window, between two frequencies that are tried
_TRIED = 12  # windows of a search
_INSIDE = 1.0 - 1e-6  # of what is searched, where least squares may begin
_SWEEPS = 2  # of both searches: the best value of one unknown depends on the others
Unknowns = Sequence[tuple[int, str]]
"""Number of an oscillator, and "frequency", "damping" or "mass"."""


def scaled(satellite: Satellite, unknowns: Unknowns, values: np.ndarray) -> Satellite:
    """Satellite with each unknown at its nominal value times exp of its value.

    A panel's inertia goes with its mass, what does not move stays as it is, and damping within its range.
    """
    changed = list(satellite.oscillators)
    for (place, what), value in zip(unknowns, values, strict=True):
        old, factor = changed[place], float(np.exp(value))
        inertia = {"inertia": old.inertia * factor} if what == "mass" and isinstance(old, Panel) else {}
        size = getattr(old, what) * factor
        changed[place] = old.replace(**{what: min(size, DAMPING_MAX) if what == "damping" else size}, **inertia)
    added, mass = np.zeros((3, 3)), 0.0
    for new, old in zip(changed, satellite.oscillators, strict=True):
        added, mass = added + new.inertia_at_rest - old.inertia_at_rest, mass + new.count * (new.mass - old.mass)
    whole = None if satellite.mass is None else satellite.mass + mass
    return satellite.replace(oscillators=changed, inertia=satellite.inertia + added, mass=whole)


def search(logs: Sequence[Log], nominal: Satellite, window: float, unknowns: Unknowns) -> tuple[np.ndarray, np.ndarray]:
    """Values (k,) of the unknowns and their covariance (k, k)."""
    std = np.array([getattr(nominal.oscillators[place], f"{what}_std") for place, what in unknowns])
    values = np.zeros(len(unknowns))
    start = estimate(logs, nominal.replace(oscillators=()), window, turns=1)
    theta = inertia_parameters(nominal.inertia, "full")
    frequencies = [k for k, (_, what) in enumerate(unknowns) if what == "frequency"]
    for k in frequencies * min(_SWEEPS, len(frequencies)):
        oscillation = 1.0 / nominal.oscillators[unknowns[k][0]].frequency
        reach, around = _REACH * std[k], 0.0
        for length in sorted({min(window, _SHORT * oscillation), window}):
            residual = _Residual(_busiest(_windows(logs, nominal, length, theta, start)), logs, nominal, unknowns)
            step = _SLIP * oscillation / length
            values[k] = around = _best_of(
                residual, values, k, std[k], around + step * np.arange(-(reach // step), reach // step + 1)
            )
            reach = 2.0 * step
    for _ in range(_SWEEPS):
        start = estimate(logs, scaled(nominal, unknowns, values), window)
        fit, windows = start.fit, _windows(logs, nominal, window, start.fit.theta, start)
        noise = row_stds(windows, fit.sigma, fit.jitter)
        residual = _Residual(windows, logs, nominal, unknowns, noise, fit.weights)
        values, jacobian = _refined(residual, values, std)
    apart = values - _refined(lambda x: residual(x, straight=True), values, std)[0]
    inflation = max([1.0, *(ratio for ratio in scatter(start.fit) if np.isfinite(ratio))])
    return values, inflation * np.linalg.inv(jacobian.T @ jacobian) + np.outer(apart, apart)


def _refined(
    residual: Callable[[np.ndarray], np.ndarray], values: np.ndarray, std: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Values (k,) with the least residual and prior together, and the residual's derivative by them."""
    found = least_squares(
        lambda x: np.concatenate([residual(x), x / std]),
        np.clip(values, -_INSIDE * _REACH * std, _INSIDE * _REACH * std),
        bounds=(-_REACH * std, _REACH * std),
        x_scale=std,
        diff_step=1e-4,
        xtol=1e-5,
        ftol=1e-6,
    )
    return found.x, found.jac


def _best_of(residual: _Residual, values: np.ndarray, k: int, std: float, tried: np.ndarray) -> float:
    """Value of unknown k among those tried with the least residual and prior together."""
    cost = []
    for value in tried:
        rows = residual(np.where(np.arange(len(values)) == k, value, values))
        cost.append(len(rows) * np.log(rows @ rows) + (value / std) ** 2)
    return float(tried[np.argmin(cost)])


def _windows(
    logs: Sequence[Log], satellite: Satellite, length: float, theta: np.ndarray, start: Estimated
) -> list[Window]:
    """Windows of a length, s, without what modes do in them."""
    return all_windows(logs, satellite, length, theta, start.delays, start.biases, modes=False)


def _busiest(windows: list[Window]) -> list[Window]:
    """Those in which the momentum's parts move the most, in order."""
    motion = [float(np.mean(window.motion**2)) for window in windows]
    return [windows[k] for k in sorted(np.argsort(motion)[-_TRIED:])]


class _Residual:
    """Residual of the momentum balance, in units of noise, by the unknowns; theta and all else are eliminated.

    Args:
        windows: without what modes do in them.
        logs, nominal, unknowns: what they are of.
        noise: of each window, (N, 3) N m s; None: 1 in all.
        weights: of each window, (N,); None: 1 in all.
    """

    def __init__(
        self,
        windows: list[Window],
        logs: Sequence[Log],
        nominal: Satellite,
        unknowns: Unknowns,
        noise: list[np.ndarray] | None = None,
        weights: list[np.ndarray] | None = None,
    ) -> None:
        self.windows, self.nominal, self.unknowns = windows, nominal, unknowns
        self.sizes, self.common = theta_sizes(nominal), common_stds(logs, nominal)
        self.noise = [np.ones((len(window), 3)) for window in windows] if noise is None else noise
        self.weights = [np.ones(len(window)) for window in windows] if weights is None else weights

    def __call__(self, values: np.ndarray, *, straight: bool = False) -> np.ndarray:
        satellite = scaled(self.nominal, self.unknowns, values)
        windows = [with_modes(window, satellite, straight=straight) for window in self.windows]
        ready = [projected_rows(*parts) for parts in zip(windows, self.noise, self.weights, strict=True)]
        theta, _, shares = solve(windows, ready, self.sizes, self.common, None)
        return np.concatenate(
            [
                rows.target - rows.design @ np.concatenate([theta, shares[window.flight].common])
                for window, rows in zip(windows, ready, strict=True)
            ]
        )
