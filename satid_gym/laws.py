"""How the true inertia varies in flight: J(t) = J0 + f(t) change.

    static    f = 0
    step      f = 0 before `time`, 1 from then on        (deployment)
    drift     f = t / time up to `time`, then 1          (fuel)
    periodic  f = sin(2 pi frequency t + phase)          (slosh)

The change is a fraction of J0, or a tensor of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from satid_gym.config import Config, check_number, real_array

InertiaMode = Literal["static", "step", "drift", "periodic"]
INERTIA_MODES: tuple[InertiaMode, ...] = get_args(InertiaMode)


@dataclass(frozen=True, eq=False)
class InertiaLaw(Config):
    """One law with its numbers.

    Attributes:
        mode: static, step, drift or periodic.
        size: the change relative to J0: change = size J0.
        time: s; when the step comes, how long the drift takes to reach its full size.
        frequency: Hz, of the periodic law.
        phase: rad, of the periodic law.
        change: (3,) or (3, 3) kg m^2, body frame; an absolute change of the tensor in place of size J0.

    Raises:
        ValueError: the mode is unknown or a number is out of range.
    """

    mode: InertiaMode
    size: float = 0.0
    time: float = 150.0
    frequency: float = 0.0
    phase: float = 0.0
    change: np.ndarray | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("size of the inertia law", self.size, low=-1.0, strict=True)
        check_number("time of the inertia law", self.time, strict=self.mode == "drift")
        check_number("frequency of the inertia law", self.frequency)
        check_number("phase of the inertia law", self.phase, low=-np.inf)
        if self.change is not None:
            change = real_array("change of the inertia law", self.change, (3,), (3, 3))
            tensor = np.diag(change) if change.ndim == 1 else change
            if not np.allclose(tensor, tensor.T):
                raise ValueError(f"change of the inertia law must be symmetric, got {tensor.tolist()}")
            object.__setattr__(self, "change", tensor)


@dataclass(frozen=True, eq=False, kw_only=True)
class LawRanges(Config):
    """Ranges from which an episode's law is drawn, uniformly; (low, high) each, times relative to the horizon.

    The defaults are the randomised laws for training; `PAPER_LAWS` are the paper's exact ones.

    Attributes:
        step_size: change of the step, relative to the inertia.
        step_time: when it comes.
        drift_size: change that the drift has reached at the horizon, relative to the inertia.
        periodic_size: amplitude of the oscillation, relative to the inertia.
        frequency: of the oscillation, Hz.
        phase: of the oscillation, rad.

    Raises:
        ValueError: a range is reversed or goes beyond what makes sense; the message says what does.
    """

    step_size: tuple[float, float] = (0.05, 0.15)
    step_time: tuple[float, float] = (0.3, 0.7)
    drift_size: tuple[float, float] = (0.02, 0.08)
    periodic_size: tuple[float, float] = (0.01, 0.05)
    frequency: tuple[float, float] = (0.01, 0.03)
    phase: tuple[float, float] = (0.0, 2.0 * np.pi)

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
}

PAPER_LAWS = LawRanges(
    step_size=(0.1, 0.1),
    step_time=(0.5, 0.5),
    drift_size=(0.05, 0.05),
    periodic_size=(0.03, 0.03),
    frequency=(0.02, 0.02),
    phase=(0.0, 0.0),
)


def paper_law(mode: InertiaMode, horizon: float = 300.0) -> InertiaLaw:
    """The paper's law of one mode over `horizon` seconds."""
    if mode == "step":
        return InertiaLaw("step", size=0.1, time=0.5 * horizon)
    if mode == "drift":
        return InertiaLaw("drift", size=0.05, time=horizon)
    if mode == "periodic":
        return InertiaLaw("periodic", size=0.03, frequency=0.02)
    return InertiaLaw(mode)
