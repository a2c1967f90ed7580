"""Laws by which the true inertia varies in flight: J(t) = J0 + f(t) change.

    static    f = 0
    step      f = 0 before `time`, 1 from then on
    drift     f = t / time up to `time`, then 1
    periodic  f = sin(2 pi frequency t + phase)

The change is a fraction of J0, or a tensor. Three laws are those of a mass m at a place r, D = m (r^2 1 - r r^T):

    deployment  +D, f = s^2 (3 - 2 s), s = (t - time) / duration within 0 and 1: it moves out from the centre to r
    fuel        -D, f = t / time up to `time`, then 1: it leaves by a nozzle whose thrust goes through the centre
    release     -D, f = 0 before `time`, 1 from then on: it leaves and takes its angular momentum D omega along

J is about the centre of mass of all that is left, which moves: for a mass m' at r from the centre of mass of the rest,
of mass M', the parallel axis theorem gives D with the reduced mass m = m' M' / (m' + M'), 1 to 5 % below m' here.
Moved straight out by the square root of f, as a deployment is, it carries no angular momentum of its own, and fuel
gives up its own on the way to the nozzle, so both keep the total; a release keeps the rate.
Source: Hughes, Spacecraft Attitude Dynamics (1986), ch. 3. Any other law is a table, linear between its knots:

    table     J(t) = factor(t) J0, or J(t) = J0 + D(t)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Self, get_args

import numpy as np

from satid_gym.config import Config, check_number, real_array
from satid_gym.core import records
from satid_gym.law_ranges import PAPER_LAWS
from satid_gym.rigid_body import point_inertia

InertiaMode = Literal["static", "step", "drift", "periodic"]
MassMode = Literal["deployment", "fuel", "release"]
LAW_NAMES: tuple[str, ...] = tuple(mode.name.lower() for mode in records.InertiaMode)
TABLE = "table"  # no mode that episodes or benchmarks draw
INERTIA_MODES: tuple[InertiaMode, ...] = get_args(InertiaMode)  # the paper's, among which "random" draws
MASS_MODES: tuple[MassMode, ...] = get_args(MassMode)
KNOTS_MAX = 8**5  # of a table


@dataclass(frozen=True, eq=False)
class InertiaLaw(Config):
    """Inertia law with its numbers.

    Attributes:
        mode: static, step, drift, periodic, deployment, fuel, release or table.
        size: the change relative to J0: change = size J0.
        time: s; when a step, a release or a deployment comes; how long drift or fuel take until their full size.
        frequency: Hz, of the periodic law, which needs one above 0.
        phase: rad, of the periodic law.
        change: (3,) or (3, 3) kg m^2, body frame; an absolute change of the tensor instead of size J0.
        mass: kg; of deployment, fuel and release, reduced as said above.
        place: (3,) m, body frame; of that mass, from the centre of mass of the rest.
        duration: s, that a deployment takes.
        times: (K,) s, increasing; the knots of a table.
        values: of a table, at its knots: factors (K,), J(t) = factor J0, or changes D (K, 3) or (K, 3, 3), kg m^2,
            body frame, J(t) = J0 + D. Linear between the knots, held before the first and after the last.
        name: its name in tables; "" for its mode.

    Raises:
        ValueError: the mode is unknown or a number is out of range.
    """

    mode: Literal[InertiaMode, MassMode, "table"]
    size: float = 0.0
    time: float = 150.0
    frequency: float = 0.0
    phase: float = 0.0
    change: np.ndarray | None = None
    mass: float | None = None
    place: np.ndarray | None = None
    duration: float = 30.0
    times: np.ndarray | None = None
    values: np.ndarray | None = None
    name: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_table()
        self._check_mass()
        check_number("size of the inertia law", self.size, low=-1.0, strict=True)
        check_number("time of the inertia law", self.time, strict=self.mode in ("drift", "fuel"))
        check_number("duration of the inertia law", self.duration, strict=True)
        check_number("frequency of the inertia law", self.frequency)
        if self.mode == "periodic" and self.frequency == 0.0:
            raise ValueError(
                'a law with mode "periodic" needs a frequency above 0 Hz, got 0: with it the inertia would not vary; '
                'give frequency, such as 0.02, or mode "static"'
            )
        check_number("phase of the inertia law", self.phase, low=-np.inf)
        if self.change is not None:
            change = real_array("change of the inertia law", self.change, (3,), (3, 3))
            tensor = np.diag(change) if change.ndim == 1 else change
            if not np.allclose(tensor, tensor.T):
                raise ValueError(f"change of the inertia law must be symmetric, got {tensor.tolist()}")
            object.__setattr__(self, "change", tensor)

    def _check_table(self) -> None:
        if self.mode != TABLE:
            if self.times is not None or self.values is not None:
                raise ValueError(f'times and values are those of a law with mode "table", this one is {self.mode!r}')
            return
        if self.times is None or self.values is None:
            raise ValueError('a law with mode "table" needs times (K,) and values (K,), (K, 3) or (K, 3, 3)')
        if self.size != 0.0 or self.change is not None:
            raise ValueError("a table has its changes in `values`: leave out `size` and `change`")
        times = real_array("times of the inertia law", self.times)
        count = len(times) if times.ndim == 1 else 0
        if not 1 <= count <= KNOTS_MAX or np.any(np.diff(times) <= 0.0):
            raise ValueError(
                f"times of the inertia law must be 1 to {KNOTS_MAX} increasing numbers of seconds, got shape "
                f"{times.shape}" + (f" with {_first_fall(times)}" if 1 <= count <= KNOTS_MAX else "")
            )
        values = real_array("values of the inertia law", self.values, (count,), (count, 3), (count, 3, 3))
        if values.ndim == 1 and np.any(values <= 0.0):
            k = int(np.argmin(values))
            raise ValueError(f"factors of the inertia law must be positive, got {values[k]:g} at {times[k]:g} s")
        if values.ndim == 3 and not np.allclose(values, values.transpose(0, 2, 1)):
            raise ValueError("values (K, 3, 3) of the inertia law must be symmetric tensors")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    def _check_mass(self) -> None:
        if self.mode not in MASS_MODES:
            if self.mass is not None or self.place is not None:
                modes = ", ".join(MASS_MODES)
                raise ValueError(f"mass and place are those of a law with mode {modes}, this one is {self.mode!r}")
            return
        if self.mass is None or self.place is None:
            raise ValueError(
                f"a law with mode {self.mode!r} needs mass, kg, and place (3,), m; "
                f'inertia="{self.mode}" draws both in each episode'
            )
        if self.size != 0.0 or self.change is not None:
            raise ValueError(f"the change of a {self.mode} follows from mass and place: leave out `size` and `change`")
        check_number("mass of the inertia law", self.mass, strict=True)
        place = real_array("place of the inertia law", self.place, (3,))
        if not place.any():
            raise ValueError("place of the inertia law must not be the centre of mass: a mass there has no inertia")
        object.__setattr__(self, "place", place)

    @property
    def mass_change(self) -> np.ndarray | None:
        """D with its sign, (3, 3) kg m^2; None of a law that moves no mass."""
        if self.mass is None or self.place is None:
            return None
        tensor = self.mass * point_inertia(self.place)
        return tensor if self.mode == "deployment" else -tensor

    @property
    def label(self) -> str:
        """Name of the law in tables."""
        return self.name or self.mode

    @property
    def relative(self) -> bool:
        """Whether the change is relative to J0: `size`, or a table of factors."""
        if self.mass is not None:
            return False
        return self.change is None if self.values is None else self.values.ndim == 1

    @property
    def changes(self) -> np.ndarray:
        """Tensors (K, 3, 3) added to J0, kg m^2; K = 0 if the change is relative."""
        given = self.mass_change if self.change is None else self.change
        if given is not None:
            return given[None]
        if self.values is None or self.values.ndim == 1:
            return np.empty((0, 3, 3))
        return self.values if self.values.ndim == 3 else self.values[:, :, None] * np.eye(3)

    @property
    def room(self) -> int:
        """Capacity of the core's table, in knots: a power of 8, because the core is compiled for each capacity."""
        return 1 if self.times is None else 8 ** max(0, int(np.ceil(np.log2(len(self.times)) / 3.0)))

    @classmethod
    def sampled(
        cls, function: Callable[[float], object], *, horizon: float = 300.0, period: float = 1.0, name: str = ""
    ) -> Self:
        """Table law from the values of a function every `period` seconds, from 0 to `horizon`.

        The error between two samples is at most period^2 / 8 times the largest second derivative: 6e-5 of J0 for a wave
        of 3 % at 0.02 Hz sampled every second.

        Args:
            function: of the time, s: a factor of J0, or a change (3,) or (3, 3) in kg m^2 that is added to J0.
            horizon: s; a multiple of the period.
            period: s.
            name: its name in tables.

        Raises:
            ValueError: the horizon is not a multiple of the period, or a value of the function is not valid.
        """
        check_number("horizon of the inertia law", horizon, strict=True)
        check_number("period of the inertia law", period, strict=True)
        count = horizon / period
        if abs(count - round(count)) > 1e-9 * count or not 1 <= round(count) < KNOTS_MAX:
            raise ValueError(f"horizon / period of the inertia law must be an integer below {KNOTS_MAX}, got {count:g}")
        times = period * np.arange(round(count) + 1)
        return cls("table", times=times, values=np.array([function(float(t)) for t in times]), name=name)


def _first_fall(times: np.ndarray) -> str:
    k = int(np.argmax(np.diff(times) <= 0.0))
    return f"{times[k + 1]:g} after {times[k]:g}"


def paper_law(mode: InertiaMode, horizon: float = 300.0) -> InertiaLaw:
    """The paper's law of one mode over `horizon` seconds."""
    if mode == "step":
        return InertiaLaw("step", size=PAPER_LAWS.step_size[0], time=PAPER_LAWS.step_time[0] * horizon)
    if mode == "drift":
        return InertiaLaw("drift", size=PAPER_LAWS.drift_size[0], time=horizon)
    if mode == "periodic":
        size, frequency, phase = PAPER_LAWS.periodic_size[0], PAPER_LAWS.frequency[0], PAPER_LAWS.phase[0]
        return InertiaLaw("periodic", size=size, frequency=frequency, phase=phase)
    return InertiaLaw(mode)
