"""Momentum of panels and tanks in windows of readings.

A mode (`satid_gym.modes.Mode`) adds c d eta/dt + S eta omega to the momentum, S its `inertia_slope`, and is driven by
the rate, eta'' + 2 zeta w eta' + w^2 eta = -c^T d omega/dt + omega^T S omega / 2. The rate is measured, so that is a
linear filter of what is known.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.signal
from scipy.interpolate import make_interp_spline

from satid_gym.identification.rows import Window, windows_of
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_FINE = 4  # steps of the filter between two readings
_CACHED = 256


def flexible_windows(
    log: Log,
    flight: int,
    satellite: Satellite,
    theta: np.ndarray,
    delays: np.ndarray,
    bias: np.ndarray,
    length: float,
    *,
    straight: bool = False,
    breaks: Sequence[float] = (),
    modes: bool = True,
) -> list[Window]:
    """Windows of a log, as of `windows_of`, with the momentum of the satellite's modes unless `modes` is false."""
    unbroken = bool(satellite.oscillators)
    found = windows_of(
        log, flight, satellite.wheels, theta, delays, bias, length, unbroken=unbroken, straight=straight, breaks=breaks
    )
    return [with_modes(window, satellite, straight=straight) for window in found] if modes else found


def with_modes(window: Window, satellite: Satellite, *, straight: bool = False) -> Window:
    """Window whose target has the momentum that the rates give modes at rest, with columns for a free oscillation.

    Between readings the wheels' momentum is interpolated on lines, since motors hold their torque, and the rate is a
    spline plus what the wheels' momentum does to it; `straight`, the rate is on lines too.
    """
    modes = satellite.modes
    if not modes:
        return window
    omega, target, own = window.omega, window.target, [window.own]
    since = window.time - window.time[0]
    fine = np.linspace(0.0, since[-1], _FINE * (len(since) - 1) + 1)
    by_wheels = np.linalg.solve(satellite.inertia, window.target.T).T
    smooth = make_interp_spline(since, omega - by_wheels, k=1 if straight else 3)(fine)
    drive = smooth + make_interp_spline(since, by_wheels, k=1)(fine)
    for mode in modes:
        w, zeta = 2.0 * np.pi * mode.frequency, mode.damping
        inputs = (drive - drive[0]) @ mode.coupling, 0.5 * np.einsum("ni,ij,nj->n", drive, mode.inertia_slope, drive)
        deflection, rate = (np.interp(since, fine, part) for part in _filtered(*inputs, fine[1], w, zeta))
        by_deflection = omega @ mode.inertia_slope  # momentum by eta
        target = target - rate[:, None] * mode.coupling - deflection[:, None] * by_deflection
        pole = w * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
        eta, eta_rate = np.exp(pole * since)[:, None], (pole * np.exp(pole * since))[:, None]
        free = eta_rate * mode.coupling + eta * by_deflection
        if (size := np.linalg.norm(free)) > 0.0:  # not of a mass that moves along its own radius
            own.append(np.stack([free.real, -free.imag], axis=2) * (np.sqrt(len(window)) / size))
    return replace(window, target=target, own=np.concatenate(own, axis=2))


def _filtered(pull: np.ndarray, push: np.ndarray, step: float, w: float, zeta: float) -> tuple[np.ndarray, np.ndarray]:
    """Eta and its rate (N,) from rest, by c^T omega (N,), 0 at first, and omega^T S omega / 2, at equal steps, s."""
    transfers, denominator = _transfers(step, w, zeta)
    by_pull, by_push = (
        [scipy.signal.lfilter(b, denominator, x) for b in part] for part, x in zip(transfers, (pull, push), strict=True)
    )
    return by_pull[0] + by_push[0], by_pull[1] + by_push[1]


@functools.lru_cache(_CACHED)
def _transfers(step: float, w: float, zeta: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Numerators by input and output, and denominator, for inputs on lines between steps; state eta, eta' + pull."""
    model = (
        np.array([[0.0, 1.0], [-(w**2), -2.0 * zeta * w]]),
        np.array([[-1.0, 0.0], [2.0 * zeta * w, 1.0]]),
        np.array([[1.0, 0.0], [0.0, 1.0]]),
        np.array([[0.0, 0.0], [-1.0, 0.0]]),
    )
    a, b, c, d, _ = scipy.signal.cont2discrete(model, step, "foh")
    found = [scipy.signal.ss2tf(a, b, c, d, which) for which in range(2)]
    return [numerator for numerator, _ in found], found[0][1]
