"""An estimator that is not compiled, in the place of the core's filter: the same decision, one sample at a time."""

from __future__ import annotations

import numpy as np

from satid_gym.config import real_array, unknown_name
from satid_gym.core import kernels
from satid_gym.core.records import MOMENTUM
from satid_gym.estimators.protocol import Estimator
from satid_gym.estimators.settings import (
    PARAMETER_COUNT,
    AdaptiveEKFSettings,
    Briefing,
    EstimatorSettings,
    MomentumEKFSettings,
    RateEKFSettings,
    estimator_settings,
)

_COORDINATES = ("momentum", "rate")


def told_settings(estimator: Estimator) -> EstimatorSettings:
    """Settings that the environment, and a policy's mission, describe an estimator by.

    Its own, where it has `settings` of the library; else the defaults of its coordinates with its parameters.

    Raises:
        ValueError: its coordinates or parameters are unknown.
    """
    coordinates = getattr(estimator, "coordinates", None)
    if coordinates not in _COORDINATES:
        raise unknown_name("coordinates of the estimator", coordinates, _COORDINATES)
    parameters = getattr(estimator, "parameters", "missing")
    if parameters not in (None, *PARAMETER_COUNT):
        raise unknown_name("parameters of the estimator", parameters, ("None", *PARAMETER_COUNT))
    own = getattr(estimator, "settings", None)
    if isinstance(own, RateEKFSettings if coordinates == "rate" else (MomentumEKFSettings, AdaptiveEKFSettings)):
        return own.replace(parameters=parameters)
    return estimator_settings({"name": coordinates, "parameters": parameters})


class ForeignFilter:
    """Runs an `Estimator` on the records of an environment with one row, and keeps the core's belief like its own.

    Args:
        estimator: the user's.
        plants, beliefs, tasks, reports: the environment's records, one row each.
        work: scratch space of the core.
        observation: (1, size) where the environment keeps its observation.
    """

    def __init__(
        self,
        estimator: Estimator,
        plants: np.ndarray,
        beliefs: np.ndarray,
        tasks: np.ndarray,
        work: np.ndarray,
        reports: np.ndarray,
        observation: np.ndarray,
    ) -> None:
        self.estimator = estimator
        self._plants, self._beliefs, self._tasks = plants, beliefs, tasks
        self._work, self._reports, self._observation = work, reports, observation

    def start(self, briefing: Briefing) -> None:
        """Take the first readings of an episode.

        Raises:
            ValueError: the estimator's mean, covariance or `accepted` is not of the shape that is asked for.
        """
        plant = self._plants[0]
        self.estimator.reset(briefing, plant["gyro"].copy(), plant["tachometer"].copy())
        self._take_belief()
        kernels.look(self._plants, self._beliefs, self._tasks, self._work, self._reports, self._observation[0])

    def decide(self, action: np.ndarray) -> bool:
        """One decision with action (n,); whether the covariance broke.

        Raises:
            ValueError: the estimator's mean, covariance or `accepted` is not of the shape that is asked for.
        """
        plant, task, report = self._plants[0], self._tasks[0], self._reports[0]
        kernels.command(self._plants, self._tasks, self._work, self._reports, action)
        if hasattr(self.estimator, "command"):
            self.estimator.command(self._work["torque"][0].copy())
        first = self._spread()
        gain = 0.0
        for _ in range(task["samples"]):
            kernels.sample(self._plants, self._tasks, self._work, self._reports)
            gyro, wheel_speed = plant["gyro"].copy(), plant["tachometer"].copy()
            self.estimator.predict(wheel_speed, float(task["sample_period"]))
            self._take_belief()
            before = self._spread()
            report["nis"] = self._update(gyro, wheel_speed)
            self._take_belief()
            gain += before - self._spread()
            kernels.note_rate(self._plants, self._beliefs, self._reports)
        report["information_gain"] = first - self._spread() if task["net"] else gain
        kernels.conclude(self._plants, self._beliefs, self._tasks, self._work, self._reports, self._observation[0])
        return bool(self._beliefs["broken"][0])

    def _update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """Give the estimator what is not flagged of a reading; its normalised innovation squared, 0 without any."""
        if not self._plants[0]["gyro_flagged"]:
            return self.estimator.update(gyro, wheel_speed)
        if hasattr(self.estimator, "update_wheels"):
            return float(self.estimator.update_wheels(wheel_speed))
        return 0.0

    def _take_belief(self) -> None:
        """Copy the estimator's state into the core's belief."""
        belief = self._beliefs[0]
        size = len(belief["mean"])
        mean, covariance = np.asarray(self.estimator.mean), np.asarray(self.estimator.covariance)
        if mean.shape != covariance.shape[:1] or covariance.shape != (*mean.shape, *mean.shape) or len(mean) < size:
            raise ValueError(
                f"the estimator's mean and covariance must have shapes (N,) and (N, N) with N >= {size}, "
                f"got {mean.shape} and {covariance.shape}"
            )
        belief["mean"] = mean[:size]
        belief["covariance"] = covariance[:size, :size]
        plant = self._plants[0]
        accepted, speed = self._accepted(plant["tachometer"])
        belief["coasting"] = plant["gyro_flagged"] or not accepted
        belief["speed"], belief["stuck"] = speed, speed != plant["tachometer"]
        if belief["kind"] == MOMENTUM:
            belief["wheel_input"][:3] = belief["axes"] @ (belief["wheel_inertia"] * speed)

    def _accepted(self, tachometer: np.ndarray) -> tuple[bool, np.ndarray]:
        """Whether the gyro's reading was accepted, and the wheel speeds (n,) to go by."""
        accepted = getattr(self.estimator, "accepted", None)
        if accepted is None:
            return True, tachometer
        if not isinstance(accepted, tuple) or len(accepted) != 2:
            raise ValueError(
                f"the estimator's `accepted` must be None or a pair (whether the gyro's reading was accepted, wheel "
                f"speeds), got {accepted!r}"
            )
        return bool(accepted[0]), real_array("the estimator's accepted wheel speeds", accepted[1], tachometer.shape)

    def _spread(self) -> float:
        return kernels.spread(self._beliefs, self._work, self._tasks["criterion"][0])
