"""Records that the core works on: plain numbers, one row an environment, bundled as `Rows`.

Truth (`plant`) and belief (`belief`) are different records, so a function that is handed the belief cannot see the
true inertia; their fields are in `core.truth.records` and `core.belief.records`. `task` (`core.task`) holds what the
episode asks for, `report` what the last decision gave.
n: wheels; p: inertia parameters (3 principal moments, or 6 with the products xy, xz, yz); size: filter state.
All in SI units and the body frame unless said otherwise.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

FLOAT, INT, UINT = np.float64, np.int64, np.uint64
Field = tuple[str, DTypeLike] | tuple[str, DTypeLike, int | tuple[int, ...]]


class InertiaMode(IntEnum):
    """Variation of the true inertia; the first four are drawn at random, the last three are those of a mass."""

    STATIC, STEP, DRIFT, PERIODIC, TABLE, DEPLOYMENT, FUEL, RELEASE = range(8)


class Criterion(IntEnum):
    """Criterion of optimal design that counts as information."""

    LOGDET, TRACE, MAXEIG = range(3)


class Fault(IntEnum):
    """Fault of a sensor or actuator that can act in a decision."""

    GYRO_DROPOUT, GYRO_OUTLIER, TACHOMETER_STUCK, WHEEL_LOSS, TORQUE_DELAY = range(5)


class Cost(IntEnum):
    """Cost of a decision: a share of its time, or of the wheels."""

    RATE, SATURATION, DEFLECTION, AVOIDED_BAND, WINDOW, KEEP_OUT = range(6)


class ObservationForm(IntEnum):
    """Whether wheels are observed one by one or by what they do to the body, see `core.observation`."""

    WHEELS, BODY = range(2)


class Autoreset(IntEnum):
    """What a step does where an episode is over; BEGIN starts episodes and decides nothing."""

    NEXT_STEP, SAME_STEP, DISABLED, BEGIN = range(4)


class Rows(NamedTuple):
    """State of N environments.

    Attributes:
        plants, beliefs, tasks, reports: (N,) records.
        observations: (N, size) float32.
        logs: (N, S) records of every sample of the last decision; (N, 0) where none is kept.
    """

    plants: np.ndarray
    beliefs: np.ndarray
    tasks: np.ndarray
    reports: np.ndarray
    observations: np.ndarray
    logs: np.ndarray


class Templates(NamedTuple):
    """State that episodes start from, one row a satellite; `draws` says how they depart from it."""

    draws: np.ndarray
    plants: np.ndarray
    beliefs: np.ndarray
    tasks: np.ndarray


class Final(NamedTuple):
    """Reports and observations of episodes that ended in a step that has begun new ones."""

    reports: np.ndarray
    observations: np.ndarray


def concatenate(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Records of one dtype in one array of the same dtype object.

    numba knows a dtype that it has seen by identity and compares one that is only equal at length, in every call;
    numpy gives what it joins a new one.
    """
    return np.concatenate(parts).view(parts[0].dtype)


@functools.cache
def report_dtype(n: int, oscillators: int = 0) -> np.dtype:
    """What the last decision gave; the source of reward and info."""
    return np.dtype(
        [
            ("reward", FLOAT),
            ("terminated", INT),
            ("truncated", INT),
            ("time", FLOAT),
            ("inertia_true", FLOAT, (3, 3)),
            ("inertia_estimate", FLOAT, (3, 3)),
            ("relative_error", FLOAT),
            ("nees", FLOAT),
            ("nis", FLOAT),
            ("information_gain", FLOAT),
            ("information_held", FLOAT),
            ("outside", FLOAT),
            ("cost", FLOAT),
            ("costs", FLOAT, len(Cost)),
            ("effort", FLOAT),
            ("in_avoided_band", FLOAT),  # share of the samples with a wheel's speed in it
            ("tracking", FLOAT),  # share of the samples at which the star tracker saw its stars
            ("saturated", np.int8, n),  # 1: at its speed limit in the decision
            ("torque_applied", FLOAT, n),
            ("constrained_updates", INT),
            ("rejected", INT),
            ("nis_mean", FLOAT),
            ("colour", FLOAT),
            ("unmodelled", np.int8),  # 1: the innovations are not those of a consistent filter
            ("inflation", FLOAT),
            ("restarts", INT),
            ("inertia_walk", FLOAT),
            ("steps_found", INT),
            ("faults", np.int8, len(Fault)),  # 1: acted in the decision
            ("deflection", FLOAT, oscillators),  # largest in the decision
            # tallies of the decision under way
            ("bent", FLOAT),  # samples with an oscillator beyond its limit
            ("read_in_band", FLOAT),  # samples at which a tachometer reads a speed in the band to avoid
            ("window_missed", FLOAT),  # samples of an open window in which the payload is off its target, or not steady
            ("in_keep_out", FLOAT),  # samples in which it looks too near the Sun
            ("peak_rate", FLOAT, 3),  # largest |rate| that the filter uses
            ("peak_bend", FLOAT),  # largest deflection that it estimates, over its limit
            ("spin_start", FLOAT, n),
        ],
        align=True,
    )


@functools.cache
def log_dtype(n: int, p: int) -> np.dtype:
    """A sample in full: truth, readings and estimate."""
    return np.dtype(
        [
            ("time", FLOAT),
            ("momentum", FLOAT, 3),
            ("rate", FLOAT, 3),
            ("wheel_speed", FLOAT, n),
            ("attitude", FLOAT, 4),
            ("inertia", FLOAT, (3, 3)),
            ("torque", FLOAT, 3),  # external
            ("gyro", FLOAT, 3),
            ("tachometer", FLOAT, n),
            ("star_tracker", FLOAT, 4),  # not a number where there is no reading
            ("theta", FLOAT, p),
            ("covariance", FLOAT, (p, p)),  # of theta, as the filter believes
        ],
        align=True,
    )
