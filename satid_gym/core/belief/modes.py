"""Modes: oscillators of the body as states of the MomentumEKF, estimated together with the inertia.

In coordinates eta of unit modal mass, with d the coupling, w the frequency and zeta the damping ratio,

    M = (J + dJ) omega + a + sum d deta/dt          p = deta/dt + d . omega          dJ = sum D eta + E eta^2
    omega = (J + dJ - sum d d^T)^-1 (M - a - sum d p)
    dp/dt = -w^2 eta - 2 zeta w deta/dt + omega . (D / 2 + E eta) omega

that is `core.truth.oscillators` to second order in deflection, d taken as constant. The states of a mode are eta, p and
the logarithms of w, |d| and zeta over nominal; D goes with |d|, both with the root of the oscillator's mass. How they
are predicted is in `mode_prediction`.
Source: Likins, Dynamics and control of flexible space vehicles, JPL TR 32-1329 (1970).
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import (
    axpy,
    axpy_symmetric,
    dot,
    load,
    load_symmetric,
    multiply,
    norm,
)
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT

STATES = 5  # eta, p, log w, log |d|, log zeta
# standard deviations that a data sheet can be wrong by: chosen by hand, on tuning and validation seeds
_SIGMAS_MAX = 4.0


@functools.cache
def modes_dtype(count: int) -> np.dtype:
    """So many modes: what is known of them before launch."""
    return np.dtype(
        [
            ("first", INT),  # index of their first state in the filter's mean
            ("coupling", FLOAT, (count, 3)),  # nominal d
            ("frequency", FLOAT, count),  # nominal w, rad/s
            ("damping", FLOAT, count),  # nominal zeta
            ("inertia_slope", FLOAT, (count, 3, 3)),  # nominal D
            ("inertia_curvature", FLOAT, (count, 3, 3)),  # E
            ("limit", FLOAT, count),  # of eta at nominal mass; infinite without one
            ("std", FLOAT, (count, STATES)),  # prior; of p that of deta/dt
            # d, w and zeta of the filter's mean
            ("d", FLOAT, (count, 3)),
            ("D", FLOAT, (count, 3, 3)),
            ("w", FLOAT, count),
            ("zeta", FLOAT, count),
        ],
        align=True,
    )


@functools.cache
def modes_work_dtype(count: int, size: int) -> np.dtype:
    """Scratch space: derivatives by the state before a prediction; void without modes."""
    size = size if count > 0 else 0
    return np.dtype(
        [
            ("omega", FLOAT, (3, size)),
            ("middle", FLOAT, (3, size)),  # of M in the middle of a step
        ],
        align=True,
    )


@inline
def moving(belief, r):
    """Index in the mean of the r-th state that a prediction moves: M, then eta and p of each mode."""
    return r if r < 3 else belief.modes.first + STATES * ((r - 3) // 2) + (r - 3) % 2


@outline
def refresh(belief):
    """Write d, w and zeta of the mean."""
    modes = belief.modes
    for i in range(modes.coupling.shape[0]):
        at = modes.first + STATES * i
        modes.w[i] = modes.frequency[i] * np.exp(belief.mean[at + 2])
        modes.zeta[i] = modes.damping[i] * np.exp(belief.mean[at + 4])
        scale = np.exp(belief.mean[at + 3])
        for k in range(3):
            modes.d[i, k] = scale * modes.coupling[i, k]
            for j in range(3):
                modes.D[i, k, j] = scale * modes.inertia_slope[i, k, j]


@inline
def have_left_data_sheet(belief):
    """Whether a frequency, size or damping is estimated further from its data sheet than that can be wrong."""
    modes, found = belief.modes, False
    for i in range(modes.coupling.shape[0]):
        for k in range(2, STATES):
            found = found or abs(belief.mean[modes.first + STATES * i + k]) > _SIGMAS_MAX * modes.std[i, k]
    return found


@inline
def body_inertia(belief, mean, inertia):
    """J + dJ - sum d d^T (symmetric) at a mean: what is left of J where the modes move freely."""
    for i in range(belief.modes.coupling.shape[0]):
        x, y, z = load(belief.modes.d[i])
        eta = mean[belief.modes.first + STATES * i]
        inertia = axpy_symmetric(eta, load_symmetric(belief.modes.D[i]), inertia)
        inertia = axpy_symmetric(eta * eta, load_symmetric(belief.modes.inertia_curvature[i]), inertia)
        inertia = axpy_symmetric(-1.0, (x * x, y * y, z * z, x * y, x * z, y * z), inertia)
    return inertia


@inline
def body_inertia_of(belief, work, fraction, inertia):
    """J - sum d d^T after a fraction of the update in work.delta, of a J that has been moved by it."""
    for i in range(belief.modes.coupling.shape[0]):
        at = belief.modes.first + STATES * i + 3
        scale = np.exp(2.0 * (belief.mean[at] + fraction * work.delta[at]))
        x, y, z = load(belief.modes.coupling[i])
        inertia = axpy_symmetric(-scale, (x * x, y * y, z * z, x * y, x * z, y * z), inertia)
    return inertia


@inline
def momentum(belief):
    """sum d p, N m s."""
    total = (0.0, 0.0, 0.0)
    for i in range(belief.modes.coupling.shape[0]):
        total = axpy(belief.mean[belief.modes.first + STATES * i + 1], load(belief.modes.d[i]), total)
    return total


@inline
def bent_rate(belief, i, eta, omega):
    """d(dJ)/deta omega of mode i, and of that the part by D."""
    by_slope = multiply(load_symmetric(belief.modes.D[i]), omega)
    return axpy(2.0 * eta, multiply(load_symmetric(belief.modes.inertia_curvature[i]), omega), by_slope), by_slope


@inline
def deflection_rate(belief, i, omega):
    """deta/dt of mode i."""
    return belief.mean[belief.modes.first + STATES * i + 1] - dot(load(belief.modes.d[i]), omega)


@inline
def spring_torque(belief, omega):
    """Torque on the body by the modes' springs and dampers, N m."""
    total = (0.0, 0.0, 0.0)
    for i in range(belief.modes.coupling.shape[0]):
        w, eta = belief.modes.w[i], belief.mean[belief.modes.first + STATES * i]
        force = w * w * eta + 2.0 * belief.modes.zeta[i] * w * deflection_rate(belief, i, omega)
        total = axpy(force, load(belief.modes.d[i]), total)
    return total


@inline
def limit_of(belief, i):
    """Limit of mode i's eta. Angle or travel is what is limited, and eta goes with the root of the mass, as d does."""
    return belief.modes.limit[i] * np.exp(belief.mean[belief.modes.first + STATES * i + 3])


@inline
def bend(belief):
    """Largest estimated deflection of the modes over its limit; 0 without any."""
    largest = 0.0
    for i in range(belief.modes.coupling.shape[0]):
        largest = max(largest, abs(belief.mean[belief.modes.first + STATES * i]) / limit_of(belief, i))
    return largest


@inline
def rung_rate(belief, i, rate_limit):
    """deta/dt that a step of the body rate by its limit, about the axis of d, rings of mode i, by nominal d."""
    return norm(load(belief.modes.coupling[i])) * rate_limit


@inline
def state_scale(belief, rate_limit, k):
    """Scale of the k-th state of the modes: what `rung_rate` is of eta and p; 1 of logarithms."""
    i, state = k // STATES, k % STATES
    if state > 1:
        return 1.0
    rung = rung_rate(belief, i, rate_limit)
    return rung / belief.modes.frequency[i] if state == 0 else rung


@outline
def start(belief, omega, rate_variance):
    """Mean and covariance at rest relative to a body that turns with omega, known to a variance about each axis."""
    modes, mean, covariance = belief.modes, belief.mean, belief.covariance
    for i in range(modes.coupling.shape[0]):
        at, d = modes.first + STATES * i, load(modes.coupling[i])
        for k in range(STATES):
            covariance[at + k, at + k] = modes.std[i, k] ** 2
        carried = dot(d, omega)
        mean[at + 1] = carried
        covariance[at + 1, at + 1] += rate_variance * dot(d, d) + (modes.std[i, 3] * carried) ** 2
        covariance[at + 1, at + 3] = covariance[at + 3, at + 1] = modes.std[i, 3] ** 2 * carried
    refresh(belief)


@outline
def write_rate_errors(belief, mean, omega, rows):
    """Columns of the modes in rows (3, size) of C, where (J - sum d d^T) domega = C dx at a mean and rate omega."""
    for i in range(belief.modes.coupling.shape[0]):
        at, d = belief.modes.first + STATES * i, load(belief.modes.d[i])
        moved, (bent, by_slope) = mean[at + 1] - 2.0 * dot(d, omega), bent_rate(belief, i, mean[at], omega)
        for r in range(3):
            for k in range(STATES):
                rows[r, at + k] = 0.0
            rows[r, at] = -bent[r]
            rows[r, at + 1] = -d[r]
            rows[r, at + 3] = -d[r] * moved - mean[at] * by_slope[r]


@inline
def load_column(a, j):
    """Column j of an array (3, N)."""
    return a[0, j], a[1, j], a[2, j]
