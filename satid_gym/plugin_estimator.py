"""Plugin estimator: a user's own instead of the core's filter; the same decision, sample by sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from satid_gym.config import real_array, unknown_name
from satid_gym.core import kernels
from satid_gym.core.belief.filters import FilterKind
from satid_gym.estimators.alignment import DataSheet
from satid_gym.estimators.compiled import CompiledEKF
from satid_gym.estimators.inertia import PARAMETER_COUNT, Parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.protocol import Estimator
from satid_gym.estimators.rate import RateEKFSettings
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.fleet import Fleet
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances


@dataclass(frozen=True, eq=False, kw_only=True)
class PluginSettings(EstimatorSettings):
    """Description of a user's own estimator to policies: the name of its class, its coordinates and parameters."""

    standard: ClassVar[type[EstimatorSettings]]
    """Settings of the library's filter in the same coordinates, whose belief record it fills."""

    def other_states(self, sheet: DataSheet) -> int:
        """As many as the standard filter has for exact sensors and wheels and a rigid body."""
        return self.standard().other_states(_exact(sheet))  # type: ignore[call-arg]

    def write(self, row: np.void, prior: FilterPrior, parameters: Parameters) -> None:
        """Write the prior as the standard filter has it."""
        self.standard(parameters=parameters).write(row, _exact(prior), parameters)  # type: ignore[call-arg]


def _exact(sheet: Any) -> Any:
    """A data sheet of a rigid body whose sensors and wheels are exact, of one instant."""
    rigid = {"modes": ()} if isinstance(sheet, FilterPrior) else {"oscillators": ()}
    return sheet.replace(tolerances=Tolerances(), sensors=Sensors(), **rigid)


@dataclass(frozen=True, eq=False, kw_only=True)
class MomentumPluginSettings(PluginSettings):
    """`PluginSettings` in momentum coordinates."""

    standard, kind, coordinates = MomentumEKFSettings, FilterKind.MOMENTUM, "momentum"


@dataclass(frozen=True, eq=False, kw_only=True)
class RatePluginSettings(PluginSettings):
    """`PluginSettings` in rate coordinates."""

    standard, kind, coordinates = RateEKFSettings, FilterKind.RATE, "rate"


_SETTINGS: dict[str, type[PluginSettings]] = {"momentum": MomentumPluginSettings, "rate": RatePluginSettings}


def plugin_settings(estimator: Estimator) -> EstimatorSettings:
    """Settings that the environment, and a policy's mission, describe an estimator by.

    Its own, where it has `settings` of the library for its coordinates; else `PluginSettings`.

    Raises:
        ValueError: its coordinates or parameters are unknown.
    """
    coordinates = getattr(estimator, "coordinates", None)
    if coordinates not in _SETTINGS:
        raise unknown_name("coordinates of the estimator", coordinates, _SETTINGS)
    parameters = getattr(estimator, "parameters", "missing")
    if parameters not in (None, *PARAMETER_COUNT):
        raise unknown_name("parameters of the estimator", parameters, ("None", *PARAMETER_COUNT))
    own = getattr(estimator, "settings", None)
    if isinstance(own, EstimatorSettings) and own.coordinates == coordinates:
        return own.replace(parameters=parameters)
    return _SETTINGS[coordinates](name=type(estimator).__name__, parameters=parameters)


class PluginFilter:
    """Runs an `Estimator` on a fleet of one, and keeps the core's belief like its own.

    Args:
        estimator: the user's.
        fleet: of the environment.
        sample: what moves the truth on by a sample and reads the sensors; None: the core.

    Raises:
        ValueError: the estimator is a reference filter, and there is a star tracker.
    """

    def __init__(self, estimator: Estimator, fleet: Fleet, sample: Callable[[], None] | None = None) -> None:
        if fleet.templates.records.beliefs["attitude"]["boresight"].size > 0 and not isinstance(estimator, CompiledEKF):
            raise ValueError(
                f"{type(estimator).__name__} takes a star tracker outside of an environment alone: use AdaptiveEKF or "
                "MomentumEKF, or sensors without star_tracker"
            )
        self.estimator, self._fleet, self._sample = estimator, fleet, sample

    def start(self, prior: FilterPrior) -> None:
        """Take the first readings of an episode.

        Raises:
            ValueError: the estimator's mean, covariance or `accepted` is not of the shape that is asked for.
        """
        rows = self._fleet.rows
        plant = rows.plants[0]
        self.estimator.reset(prior, plant["gyro"].copy(), plant["tachometer"].copy())
        self._update_attitude()
        self._take_belief()
        kernels.look(rows, self._fleet.work)

    def decide(self, action: np.ndarray) -> None:
        """One decision with an action, (n,) torques or (3,) rates.

        Raises:
            ValueError: the estimator's mean, covariance or `accepted` is not of the shape that is asked for.
            FloatingPointError: its covariance is no longer positive definite, or its estimate not finite.
        """
        rows, work = self._fleet.rows, self._fleet.work
        plant, task, report = rows.plants[0], rows.tasks[0], rows.reports[0]
        kernels.command(rows, work, action)
        first = self._uncertainty() if task["net"] else 0.0
        gain = 0.0
        for _ in range(task["samples"]):
            kernels.steer(rows, work)
            if hasattr(self.estimator, "command"):
                self.estimator.command(work["torque"][0].copy())
            if self._sample is None:
                kernels.sample(rows, work)
            else:
                self._sample()
            if isinstance(self.estimator, CompiledEKF):
                kernels.announce(rows, self.estimator.records)
            gyro, wheel_speed = plant["gyro"].copy(), plant["tachometer"].copy()
            self.estimator.predict(wheel_speed, float(task["sample_period"]))
            self._take_belief()
            before = self._uncertainty()
            report["nis"] = self._update(gyro, wheel_speed)
            self._take_belief()
            gain += before - self._uncertainty()
            kernels.note_update(rows)
        report["information_gain"] = first - self._uncertainty() if task["net"] else gain
        kernels.conclude(rows, work)
        self._fleet.check(int(rows.beliefs["broken"][0]))

    def _update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Give the estimator what is not flagged of a reading; its normalised innovation squared, 0 without any."""
        nis = 0.0
        if not self._fleet.rows.plants[0]["gyro_flagged"]:
            nis = self.estimator.update(gyro, wheel_speed)
        elif hasattr(self.estimator, "update_wheels"):
            nis = float(self.estimator.update_wheels(wheel_speed))
        self._update_attitude()
        return nis

    def _update_attitude(self) -> None:
        tracker = self._fleet.rows.plants[0]["tracker"]
        if tracker["fresh"] and hasattr(self.estimator, "update_attitude"):
            self.estimator.update_attitude(tracker["reading"].copy())

    def _take_belief(self) -> None:
        """Copy the estimator's state into the core's belief."""
        belief = self._fleet.rows.beliefs[0]
        size = len(belief["mean"])
        mean, covariance = np.asarray(self.estimator.mean), np.asarray(self.estimator.covariance)
        if mean.shape != covariance.shape[:1] or covariance.shape != (*mean.shape, *mean.shape) or len(mean) < size:
            raise ValueError(
                f"the estimator's mean and covariance must have shapes (N,) and (N, N) with N >= {size}, "
                f"got {mean.shape} and {covariance.shape}"
            )
        belief["mean"] = mean[:size]
        belief["covariance"] = covariance[:size, :size]
        plant = self._fleet.rows.plants[0]
        accepted, speed = self._accepted(plant["tachometer"])
        belief["coasting"] = plant["gyro_flagged"] or not accepted
        belief["speed"] = belief["gate"]["speed"] = speed
        belief["stuck"] = speed != plant["tachometer"]
        if isinstance(self.estimator, CompiledEKF):
            for name in ("wheel_input", "alignment", "modes", "attitude"):  # with the mean, the rate follows from these
                belief[name] = self.estimator.record[name]
            for name in ("whiteness", "adaptation"):  # what info tells of the filter
                belief[name] = self.estimator.record[name]
        elif belief["kind"] == FilterKind.MOMENTUM:
            belief["wheel_input"][:3] = belief["axes"] @ (belief["wheel_inertia"] * speed)

    def _accepted(self, tachometer: np.ndarray) -> tuple[bool, np.ndarray]:
        """Whether the gyro's reading was accepted, and the wheel speeds (n,) that it uses."""
        accepted = getattr(self.estimator, "accepted", None)
        if accepted is None:
            return True, tachometer
        if not isinstance(accepted, tuple) or len(accepted) != 2:
            raise ValueError(
                f"the estimator's `accepted` must be None or a pair (whether the gyro's reading was accepted, wheel "
                f"speeds), got {accepted!r}"
            )
        return bool(accepted[0]), real_array("the estimator's accepted wheel speeds", accepted[1], tachometer.shape)

    def _uncertainty(self) -> float:
        rows = self._fleet.rows
        return float(kernels.uncertainty_nats(rows.beliefs, self._fleet.work, rows.tasks["criterion"][0]))
