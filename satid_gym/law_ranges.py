"""Ranges from which an episode's inertia law is drawn, and the paper's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.config import Config, real_array


@dataclass(frozen=True, eq=False, kw_only=True)
class LawRanges(Config):
    """Ranges from which an episode's law is drawn, uniformly; (low, high) each, times relative to the horizon.

    The defaults are the randomised laws for training; `PAPER_LAWS` are the paper's exact ones. Of a mass m at r only
    m r^2 and the direction of r count: the first is drawn relative to the mean moment tr(J0) / 3, the second on the
    sphere; a body that could not hold the mass is drawn again.

    Attributes:
        step_size: change of the step, relative to the inertia.
        step_time: time of the step.
        drift_size: change by the drift at the horizon, relative to the inertia.
        periodic_size: amplitude of the oscillation, relative to the inertia.
        frequency: of the oscillation, Hz.
        phase: of the oscillation, rad.
        deployment_size: m r^2 of the mass that a deployment moves out, relative to the mean moment.
        deployment_time: start of the deployment.
        deployment_duration: duration of the deployment, s.
        fuel_size: m r^2 of the fuel used up at the horizon, relative to the mean moment.
        release_size: m r^2 of the payload that is released, relative to the mean moment.
        release_time: time of the release.

    Raises:
        ValueError: a range is reversed or outside its bounds; the message gives them.
    """

    step_size: tuple[float, float] = (0.05, 0.15)
    step_time: tuple[float, float] = (0.3, 0.7)
    drift_size: tuple[float, float] = (0.02, 0.08)
    periodic_size: tuple[float, float] = (0.01, 0.05)
    frequency: tuple[float, float] = (0.01, 0.03)
    phase: tuple[float, float] = (0.0, 2.0 * np.pi)
    deployment_size: tuple[float, float] = (0.05, 0.3)
    deployment_time: tuple[float, float] = (0.2, 0.6)
    deployment_duration: tuple[float, float] = (5.0, 60.0)
    fuel_size: tuple[float, float] = (0.02, 0.08)
    release_size: tuple[float, float] = (0.05, 0.15)
    release_time: tuple[float, float] = (0.3, 0.7)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, (least, most) in _LAW_BOUNDS.items():
            value = real_array(f"{name} of the law ranges", getattr(self, name), (2,))
            low, high = value.tolist()
            if not least <= low <= high <= most:
                raise ValueError(
                    f"{name} of the law ranges must be (low, high) with {least} <= low <= high <= {most}, "
                    f"got ({low}, {high})"
                )
            object.__setattr__(self, name, (low, high))


_LAW_BOUNDS = {
    "step_size": (-0.9, 10.0),
    "step_time": (0.0, 1.0),
    "drift_size": (-0.9, 10.0),
    "periodic_size": (0.0, 0.9),
    "frequency": (0.0, 10.0),
    "phase": (-100.0, 100.0),
    "deployment_size": (0.0, 100.0),
    "deployment_time": (0.0, 1.0),
    "deployment_duration": (0.1, 1e6),
    "fuel_size": (0.0, 1.0),
    "release_size": (0.0, 1.0),
    "release_time": (0.0, 1.0),
}

PAPER_LAWS = LawRanges(
    step_size=(0.1, 0.1),
    step_time=(0.5, 0.5),
    drift_size=(0.05, 0.05),
    periodic_size=(0.03, 0.03),
    frequency=(0.02, 0.02),
    phase=(0.0, 0.0),
)
