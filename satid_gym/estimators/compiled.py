"""Compiled EKF: a filter of the core behind the estimators' protocol."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym.config import check_number, real_array
from satid_gym.core import kernels
from satid_gym.estimators.inertia import Parameters
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.records import new_belief, new_work
from satid_gym.estimators.settings import Coordinates, EstimatorSettings


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterRun:
    """Estimates of a filter over N readings.

    Attributes:
        mean: (N, size).
        covariance: (N, size, size).
        nis: (N,) normalised innovation squared per degree of freedom; 0 at the first reading.
        parameters: p, how many of the state are inertia parameters.
        constrained_updates: updates shortened because the inertia would not have stayed positive definite.
        scale_variance: variance of a common factor on the inertia that no excitation finds; the state's covariance is
            without it, the inertia's with it.
    """

    mean: np.ndarray
    covariance: np.ndarray
    nis: np.ndarray
    parameters: int
    constrained_updates: int
    scale_variance: float = 0.0

    @property
    def inertia(self) -> np.ndarray:
        """(N, p) kg m^2."""
        return self.mean[:, 3 : 3 + self.parameters]

    @property
    def inertia_covariance(self) -> np.ndarray:
        """(N, p, p)."""
        block = slice(3, 3 + self.parameters)
        common = self.scale_variance * self.inertia[:, :, None] * self.inertia[:, None, :]
        return self.covariance[:, block, block] + common


class CompiledEKF:
    """Base of the core's filters, such as `MomentumEKF` and `RateEKF`.

    Attributes:
        settings: its settings.
    """

    def __init__(self, settings: EstimatorSettings) -> None:
        self.settings = settings
        self._records: np.ndarray | None = None
        self._work: Any = None

    @property
    def records(self) -> np.ndarray:
        """(1,) belief record of the core, see `satid_gym.core.belief.records`; what is written to it counts.

        Raises:
            RuntimeError: `reset` was not called.
        """
        if self._records is None:
            raise RuntimeError("the filter has no belief yet: call reset(prior, gyro, wheel_speed) first")
        return self._records

    @property
    def record(self) -> np.void:
        """Row 0 of `records`."""
        return self.records[0]

    @property
    def work(self) -> Any:
        """(1,) scratch space of the core."""
        return self._work

    @property
    def coordinates(self) -> Coordinates:
        """Coordinates of its state."""
        return self.settings.coordinates

    @property
    def parameters(self) -> Parameters | None:
        """ "principal", "full", or None: what the prior needs."""
        return self.settings.parameters

    @property
    def mean(self) -> np.ndarray:
        """(size,) state."""
        return self.record["mean"].copy()

    @property
    def covariance(self) -> np.ndarray:
        """(size, size)."""
        return self.record["covariance"].copy()

    @property
    def constrained_updates(self) -> int:
        """Updates shortened because the inertia would not have stayed positive definite."""
        return int(self.record["constrained_updates"])

    def reset(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from what is known before launch and the first reading."""
        self._prepare(prior)
        kernels.start_filter(self.records, self.work, real_array("gyro", gyro, (3,)), self._speed(wheel_speed))

    def command(self, torque: np.ndarray) -> None:
        """Note the motor torque (n,) commanded from now on, N m; wheels without tachometer are assumed to follow it.

        It also tells what the body does in the time by which readings are late.
        """
        self._work["torque"][0] = real_array("torque", torque, self.record["wheel_inertia"].shape)

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """Move the belief on by dt seconds to the reading `wheel_speed` (n,)."""
        kernels.predict_filter(self.records, self.work, self._speed(wheel_speed), check_number("dt", dt, strict=True))

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Update with the reading; returns the normalised innovation squared per degree of freedom."""
        readings = real_array("gyro", gyro, (3,)), self._speed(wheel_speed)
        return float(kernels.condition_filter(self.records, self.work, *readings))

    def update_wheels(self, wheel_speed: np.ndarray) -> float:
        """Update with the tachometers alone, where the gyro's reading is not valid; returns what `update` does."""
        return float(kernels.condition_filter_wheels(self.records, self.work, self._speed(wheel_speed)))

    def update_attitude(self, attitude: np.ndarray) -> float:
        """Update with a reading (4,) of the star tracker, body to inertial, scalar last; NIS per degree of freedom.

        NIS is 0 where the attitude begins with this reading, a gate finds that it repeats the last, or it waits for
        the state, if readings of gyro and wheels are late or averaged.

        Raises:
            ValueError: the prior has no star tracker, or the reading is not finite or of length 0.
        """
        reading = real_array("attitude", attitude, (4,))
        if not reading.any():
            raise ValueError("attitude must be a quaternion, body to inertial, scalar last, got 0 0 0 0")
        if len(self.record["attitude"]["boresight"]) == 0:
            raise ValueError("there is no star tracker: give reset a prior whose sensors have a star_tracker")
        return float(kernels.condition_filter_attitude(self.records, self.work, reading))

    @property
    def accepted(self) -> tuple[bool, np.ndarray] | None:
        """Whether the gyro's last reading was accepted, and the wheel speeds (n,) that it uses; None without a gate."""
        row = self.record
        return (not row["coasting"], row["gate"]["speed"].copy()) if row["gate"]["threshold"] > 0.0 else None

    def run(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray, dt: float) -> FilterRun:
        """Filter a whole series of readings.

        Args:
            prior: what is known before.
            gyro: (N, 3) rad/s; the first reading starts the belief.
            wheel_speed: (N, n) rad/s.
            dt: s between readings.

        Raises:
            ValueError: a shape or a value is wrong.
        """
        n = prior.wheels.count
        gyro = np.ascontiguousarray(real_array("gyro", gyro))
        if gyro.ndim != 2 or gyro.shape[1] != 3 or len(gyro) == 0:
            raise ValueError(f"gyro must have shape (N, 3) with N >= 1, got {gyro.shape}")
        wheel_speed = np.ascontiguousarray(real_array("wheel_speed", wheel_speed, (len(gyro), n)))
        self._prepare(prior)
        size = len(self.record["mean"])
        mean, nis = np.empty((len(gyro), size)), np.empty(len(gyro))
        covariance = np.empty((len(gyro), size, size))
        dt = check_number("dt", dt, strict=True)
        kernels.run_filter(self.records, self.work, gyro, wheel_speed, dt, mean, covariance, nis)
        p = len(self.record["prior_theta"])
        return FilterRun(
            mean=mean,
            covariance=covariance,
            nis=nis,
            parameters=p,
            constrained_updates=self.constrained_updates,
            scale_variance=float(self.record["scale_variance"]),
        )

    def _prepare(self, prior: FilterPrior) -> None:
        self._records = new_belief(prior, self.settings)
        self._work = new_work(self._records)

    def _speed(self, wheel_speed: np.ndarray) -> np.ndarray:
        return real_array("wheel_speed", wheel_speed, self.record["wheel_inertia"].shape)
