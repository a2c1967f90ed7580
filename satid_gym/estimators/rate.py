"""RateEKF, the paper's filter: its settings and its compiled form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from satid_gym.config import check_number
from satid_gym.core.belief.filters import FilterKind
from satid_gym.estimators.alignment import DataSheet
from satid_gym.estimators.compiled import CompiledEKF
from satid_gym.estimators.inertia import PARAMETER_COUNT, Parameters
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.settings import EstimatorSettings


@dataclass(frozen=True, eq=False, kw_only=True)
class RateEKFSettings(EstimatorSettings):
    """Tuning of the RateEKF; the defaults are the paper's.

    Attributes:
        name: "rate".
        gyro_std: measurement noise it assumes, rad/s.
        wheel_speed_std: likewise of the wheel speeds, rad/s.
        rate_walk: process noise, rad/s per sqrt(s).
        inertia_walk: kg m^2 per sqrt(s).
        wheel_speed_walk: rad/s per sqrt(s).
        prior_rate_std: rad/s.
        prior_inertia_std: kg m^2.
        prior_wheel_speed_std: rad/s.

    Raises:
        ValueError: a value is out of range.
    """

    kind = FilterKind.RATE
    coordinates = "rate"

    name: Literal["rate"] = "rate"
    gyro_std: float = 1e-3
    wheel_speed_std: float = 1.0
    rate_walk: float = 1e-3
    inertia_walk: float = 1e-5
    wheel_speed_walk: float = 1e-3
    prior_rate_std: float = 1e-2
    prior_inertia_std: float = 1.0
    prior_wheel_speed_std: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("gyro_std", "wheel_speed_std", "prior_rate_std", "prior_inertia_std", "prior_wheel_speed_std"):
            check_number(name, getattr(self, name), strict=True)
        for name in ("rate_walk", "inertia_walk", "wheel_speed_walk"):
            check_number(name, getattr(self, name))

    def other_states(self, sheet: DataSheet) -> int:
        """Body rate and wheel speeds."""
        return 3 + sheet.wheels.count

    def write(self, row: np.void, prior: FilterPrior, parameters: Parameters) -> None:
        """Write tuning to a belief record.

        Raises:
            ValueError: the sensors' readings are not of one instant, or there is a star tracker.
        """
        if prior.sensors.star_tracker is not None:
            raise ValueError("the RateEKF takes no star tracker: use AdaptiveEKF, or sensors without star_tracker")
        if prior.sensors.are_timed:
            raise ValueError(
                "the RateEKF takes gyro and tachometers as read at one instant: use AdaptiveEKF, or sensors that "
                "neither integrate nor count, without delay"
            )
        p = PARAMETER_COUNT[parameters]
        row["gyro_std"], row["tachometer_std"] = self.gyro_std, self.wheel_speed_std
        row["prior_theta_std"] = self.prior_inertia_std
        row["prior_std"] = self.prior_rate_std, self.prior_wheel_speed_std
        row["walk"][:3] = self.rate_walk
        row["walk"][3 : 3 + p] = self.inertia_walk
        row["walk"][3 + p :] = self.wheel_speed_walk


class RateEKF(CompiledEKF):
    """The paper's filter: x = [omega, theta, Omega].

    Args:
        **settings: fields of `RateEKFSettings`.
    """

    def __init__(self, **settings: object) -> None:
        super().__init__(RateEKFSettings.from_dict(settings))
