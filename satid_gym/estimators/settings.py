"""Settings of an estimator: its parameters, and what the core's belief record needs of them."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from satid_gym.config import Config
from satid_gym.core.belief.filters import FilterKind
from satid_gym.estimators.alignment import DataSheet
from satid_gym.estimators.inertia import Parameters
from satid_gym.estimators.prior import FilterPrior

Coordinates = Literal["momentum", "rate"]


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimatorSettings(Config, abc.ABC):
    """Base of the settings of every estimator.

    Attributes:
        name: of the estimator.
        parameters: "principal" for 3 moments along the body axes, "full" for all 6 of the tensor; None is "full" where
            a satellite, the inertia law or `tilt_std` has products of inertia about the body axes, else "principal".
    """

    kind: ClassVar[FilterKind]
    """Filter of the core whose layout its belief has."""
    coordinates: ClassVar[Coordinates]

    name: str
    parameters: Parameters | None = None

    def mode_count(self, sheet: DataSheet) -> int:
        """How many modes of the body it estimates for such a data sheet."""
        return 0

    def tells_attitude(self, sheet: DataSheet) -> bool:
        """Whether it estimates the attitude for such a data sheet."""
        return False

    def tells_sky(self, sheet: DataSheet) -> tuple[bool, bool]:
        """Whether it can tell where Sun and Earth are, which matters where they blind a star tracker."""
        tracker = sheet.sensors.star_tracker
        if tracker is None or not self.tells_attitude(sheet):
            return False, False
        return tracker.sun_exclusion is not None, tracker.earth_exclusion is not None

    @abc.abstractmethod
    def other_states(self, sheet: DataSheet) -> int:
        """Number of the filter's states that are no inertia parameters, for such a data sheet."""

    def calibration_states(self, sheet: DataSheet) -> int:
        """How many of these are errors of sensors and wheels, the last ones."""
        return 0

    @abc.abstractmethod
    def write(self, row: np.void, prior: FilterPrior, parameters: Parameters) -> None:
        """Write prior and tuning to a belief record that has axes, wheel_inertia, prior_theta and theta_scale."""
