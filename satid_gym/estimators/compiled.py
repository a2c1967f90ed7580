"""MomentumEKF, AdaptiveEKF and RateEKF: the core's filters behind the estimators' protocol."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from satid_gym.config import check_number, real_array
from satid_gym.core import kernels
from satid_gym.estimators.belief import new_belief, new_work
from satid_gym.estimators.settings import (
    AdaptiveEKFSettings,
    Briefing,
    EstimatorSettings,
    MomentumEKFSettings,
    Parameters,
    RateEKFSettings,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterRun:
    """A filter's course over N readings.

    Attributes:
        mean: (N, size).
        covariance: (N, size, size).
        nis: (N,) normalised innovation squared per degree of freedom; 0 at the first reading.
        parameters: p, how many of the state are inertia parameters.
        guarded: updates shortened because the inertia would not have stayed positive definite.
    """

    mean: np.ndarray
    covariance: np.ndarray
    nis: np.ndarray
    parameters: int
    guarded: int

    @property
    def inertia(self) -> np.ndarray:
        """(N, p) kg m^2."""
        return self.mean[:, 3 : 3 + self.parameters]

    @property
    def inertia_covariance(self) -> np.ndarray:
        """(N, p, p)."""
        block = slice(3, 3 + self.parameters)
        return self.covariance[:, block, block]


class CompiledEKF:
    """One of the core's filters; made by `MomentumEKF`, `AdaptiveEKF` or `RateEKF`."""

    coordinates: Literal["momentum", "rate"]

    def __init__(self, settings: EstimatorSettings) -> None:
        self.settings = settings
        self._rows: Any = np.zeros(0)
        self._work: Any = None

    @property
    def parameters(self) -> Parameters | None:
        """ "principal", "full", or None: what the briefing needs."""
        return self.settings.parameters

    @property
    def mean(self) -> np.ndarray:
        """(size,) state."""
        return self._started()["mean"].copy()

    @property
    def covariance(self) -> np.ndarray:
        """(size, size)."""
        return self._started()["covariance"].copy()

    @property
    def guarded(self) -> int:
        """Updates shortened because the inertia would not have stayed positive definite."""
        return int(self._started()["guarded"])

    def reset(self, briefing: Briefing, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        self._brief(briefing)
        kernels.start_filter(self._rows, self._work, self._gyro(gyro), self._speed(wheel_speed))

    def command(self, torque: np.ndarray) -> None:
        """Take note of the motor torque (n,) commanded from now on, N m; wheels without tachometer follow it."""
        self._work["torque"][0] = real_array("torque", torque, self._started()["wheel_inertia"].shape)

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        self._started()
        kernels.predict_filter(self._rows, self._work, self._speed(wheel_speed), check_number("dt", dt, strict=True))

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Take in the reading; returns the normalised innovation squared per degree of freedom."""
        self._started()
        readings = self._gyro(gyro), self._speed(wheel_speed)
        return float(kernels.condition_filter(self._rows, self._work, *readings))

    @property
    def accepted(self) -> tuple[bool, np.ndarray] | None:
        """Whether the gyro's last reading was accepted, and the wheel speeds (n,) to go by; None without a gate."""
        row = self._started()
        return (not row["coasting"], row["speed"].copy()) if row["gate"] > 0.0 else None

    def run(self, briefing: Briefing, gyro: np.ndarray, wheel_speed: np.ndarray, dt: float) -> FilterRun:
        """Filter a whole series of readings.

        Args:
            briefing: what is known before.
            gyro: (N, 3) rad/s; the first reading starts the belief.
            wheel_speed: (N, n) rad/s.
            dt: s between readings.

        Raises:
            ValueError: a shape or a value is wrong.
        """
        n = briefing.wheels.count
        gyro = np.ascontiguousarray(real_array("gyro", gyro))
        if gyro.ndim != 2 or gyro.shape[1] != 3 or len(gyro) == 0:
            raise ValueError(f"gyro must have shape (N, 3) with N >= 1, got {gyro.shape}")
        wheel_speed = np.ascontiguousarray(real_array("wheel_speed", wheel_speed, (len(gyro), n)))
        self._brief(briefing)
        size = self._rows["mean"].shape[1]
        mean, nis = np.empty((len(gyro), size)), np.empty(len(gyro))
        covariance = np.empty((len(gyro), size, size))
        dt = check_number("dt", dt, strict=True)
        kernels.run_filter(self._rows, self._work, gyro, wheel_speed, dt, mean, covariance, nis)
        p = self._rows["prior_theta"].shape[1]
        return FilterRun(mean=mean, covariance=covariance, nis=nis, parameters=p, guarded=self.guarded)

    def _brief(self, briefing: Briefing) -> None:
        self._rows = new_belief(briefing, self.settings)
        self._work = new_work(self._rows)

    def _started(self) -> np.void:
        if not len(self._rows):
            raise RuntimeError("the filter has no belief yet: call reset(briefing, gyro, wheel_speed) first")
        return self._rows[0]

    def _gyro(self, gyro: np.ndarray) -> np.ndarray:
        return real_array("gyro", gyro, (3,))

    def _speed(self, wheel_speed: np.ndarray) -> np.ndarray:
        return real_array("wheel_speed", wheel_speed, (self._rows["wheel_inertia"].shape[1],))


class MomentumEKF(CompiledEKF):
    """The EKF in momentum coordinates, with one walk of the inertia: x = [M, theta, tau].

    Args:
        **settings: fields of `MomentumEKFSettings`.
    """

    coordinates = "momentum"

    def __init__(self, **settings: object) -> None:
        super().__init__(MomentumEKFSettings.from_dict(settings))


class AdaptiveEKF(CompiledEKF):
    """The default filter: the MomentumEKF that finds out how fast the inertia walks, and when it steps.

    Args:
        **settings: fields of `AdaptiveEKFSettings`.
    """

    coordinates = "momentum"
    settings: AdaptiveEKFSettings

    def __init__(self, **settings: object) -> None:
        super().__init__(AdaptiveEKFSettings.from_dict(settings))

    @property
    def inertia_walk(self) -> float:
        """Random walk of each moment relative to its prior, per sqrt(s), that the last prediction took."""
        row = self._started()
        return float(row["walk"][3] / row["theta_scale"][0])

    @property
    def steps(self) -> int:
        """Steps of the inertia that were found."""
        return int(self._started()["steps"])


class RateEKF(CompiledEKF):
    """The paper's filter: x = [omega, theta, Omega].

    Args:
        **settings: fields of `RateEKFSettings`.
    """

    coordinates = "rate"

    def __init__(self, **settings: object) -> None:
        super().__init__(RateEKFSettings.from_dict(settings))

    def update_wheels(self, wheel_speed: np.ndarray) -> float:
        """Take in the tachometers' reading alone; returns its normalised innovation squared per degree of freedom."""
        self._started()
        return float(kernels.condition_filter_wheels(self._rows, self._work, self._speed(wheel_speed)))
