"""Appendages that a scenario gives its satellites: panels and tanks whose data sheets are drawn from ranges."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym.config import Config, check_integer, check_number, real_array
from satid_gym.oscillators import Oscillator, Panel, SloshMass
from satid_gym.satellite import Satellite

_SHEETS_MAX = 1000
_DRAWS_MAX = 1000
_LOG_STD_MAX = 0.5  # as of an oscillator


@dataclass(frozen=True, eq=False, kw_only=True)
class Appendages(Config, abc.ABC):
    """Base class of log-uniform ranges (low, high) from which `sheets` data sheets are drawn.

    Attributes:
        share: for panels d^2 / J, the share of an axis's inertia that moves with their mode (d: `Mode.coupling`); for a
            tank the share of the mass that sloshes.
        frequency: Hz, of the data sheet.
        damping: damping ratio of the data sheet.
        mass_std: std of the logarithm of the true mass about the data sheet's.
        frequency_std: the same for the frequency.
        damping_std: the same for the damping ratio.
        deflection_limit: rad for panels, m for a tank's mass; None: no limit.
        sheets: data sheets to draw; an episode flies one of them.
        seed: seed of these draws, which are the same for all satellites, scaled to each. A sheet that a satellite
            cannot carry is drawn again.

    Raises:
        ValueError: a range is reversed or out of bounds, or a number is out of range.
    """

    share: tuple[float, float]
    frequency: tuple[float, float]
    damping: tuple[float, float]
    mass_std: float = 0.2
    frequency_std: float = 0.3
    damping_std: float = 0.3
    deflection_limit: float | None = None
    sheets: int = 32
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, most in (("share", 0.5), ("frequency", 100.0), ("damping", 0.5)):
            object.__setattr__(self, name, range_of(f"{name} of the appendages", getattr(self, name), most))
        for name in ("mass_std", "frequency_std", "damping_std"):
            check_number(f"{name} of the appendages", getattr(self, name), high=_LOG_STD_MAX)
        check_integer("sheets of the appendages", self.sheets, high=_SHEETS_MAX)
        check_integer("seed of the appendages", self.seed, low=0)
        if self.deflection_limit is not None:
            check_number("deflection_limit of the appendages", self.deflection_limit, strict=True)

    def equip(self, satellite: Satellite) -> tuple[Satellite, ...]:
        """The satellite with these appendages, once for each data sheet; unchanged if it already is one of these.

        Raises:
            ValueError: it has oscillators of its own, lacks what places them, or carries none of 1000 draws.
        """
        bare = satellite.replace(oscillators=())
        rows = [np.random.default_rng([self.seed, i]) for i in range(self.sheets)]
        equipped = tuple(self._carried(bare, rng) for rng in rows)
        if not satellite.oscillators:
            return equipped
        if satellite in equipped:
            return (satellite,)
        raise ValueError(
            f"the scenario gives satellites their panels or tanks, and {satellite.name!r} has oscillators of its "
            "own: fly it in another scenario, or without them"
        )

    @abc.abstractmethod
    def draw(self, satellite: Satellite, rng: np.random.Generator) -> Oscillator:
        """One data sheet."""

    def _carried(self, bare: Satellite, rng: np.random.Generator) -> Satellite:
        """The satellite with the first data sheet drawn that it can carry."""
        for _ in range(_DRAWS_MAX):
            oscillator = self.draw(bare, rng)
            try:
                return bare.replace(oscillators=(oscillator,))
            except ValueError as error:
                reason = error
        raise ValueError(
            f"{bare.name} can carry none of {_DRAWS_MAX} data sheets drawn from the scenario's appendages: give these "
            f"a smaller share; of the last one, {reason}"
        )

    def _drawn(self, rng: np.random.Generator) -> tuple[float, dict[str, Any]]:
        """Share, and settings that all oscillators have."""
        share, frequency, damping = (
            float(np.exp(rng.uniform(*np.log(getattr(self, name))))) for name in ("share", "frequency", "damping")
        )
        names = ("mass_std", "frequency_std", "damping_std", "deflection_limit")
        return share, {"frequency": frequency, "damping": damping} | {name: getattr(self, name) for name in names}


@dataclass(frozen=True, eq=False, kw_only=True)
class Panels(Appendages):
    """A mirrored pair of thin panels along a body axis, hinged about another; both axes are random."""

    def draw(self, satellite: Satellite, rng: np.random.Generator) -> Panel:
        """One data sheet.

        Raises:
            ValueError: the satellite has no size.
        """
        along, about = rng.permutation(3)[:2].tolist()
        share, others = self._drawn(rng)
        return panel_pair(satellite, share, along, about, **others)


@dataclass(frozen=True, eq=False, kw_only=True)
class Tank(Appendages):
    """A sloshing mass at a random place, which moves perpendicular to its position vector.

    Attributes:
        arm: distance from the centre of mass, as a share of the satellite's mean size.
    """

    arm: tuple[float, float] = (0.25, 0.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "arm", range_of("arm of the tank", self.arm, 2.0))

    def draw(self, satellite: Satellite, rng: np.random.Generator) -> SloshMass:
        """One data sheet.

        Raises:
            ValueError: the satellite has no mass or size.
        """
        place, way = rng.standard_normal((2, 3))
        place /= np.linalg.norm(place)
        way -= way @ place * place
        share, others = self._drawn(rng)
        arm = rng.uniform(*self.arm)
        _check(satellite, "mass", "size")
        return SloshMass(
            mass=share * float(satellite.mass or 0.0),
            position=arm * float(np.mean(satellite.size)) * place,  # type: ignore[arg-type]
            direction=way / np.linalg.norm(way),
            **others,
        )


def panel_pair(satellite: Satellite, share: float, along: int, about: int, **others: Any) -> Panel:
    """Two thin panels, twice as long as the satellite, at its sides.

    Args:
        satellite: nominal, with its size.
        share: of the moment of inertia about the hinges' axis.
        along, about: body axes that the panels lie along and turn about.
        others: settings of `Panel`.

    Raises:
        ValueError: the satellite has no size.
    """
    _check(satellite, "size")
    size = float(satellite.size[along])  # type: ignore[index]
    hinge, arm = 0.5 * size, size
    own = arm**2 / 3.0  # of a plate twice as long as the arm, by its mass
    by_mass = 2.0 * ((hinge + arm) * arm + own) ** 2 / (arm**2 + own)
    mass = share * float(satellite.inertia[about, about]) / by_mass
    way, across = np.eye(3)[along], np.eye(3)[about]
    return Panel(
        mass=mass,
        hinge=hinge * way,
        axis=across,
        arm=arm * way,
        inertia=mass * own * (1.0 - way),
        mirrored=True,
        **others,
    )


def range_of(name: str, value: object, most: float) -> tuple[float, float]:
    """(low, high) with 0 < low <= high <= most.

    Raises:
        ValueError: the value is no such range.
    """
    low, high = real_array(name, value, (2,)).tolist()
    if not 0.0 < low <= high <= most:
        raise ValueError(f"{name} must be (low, high) with 0 < low <= high <= {most:g}, got ({low}, {high})")
    return low, high


def appendages_of(value: object) -> Appendages:
    """Panels or a tank, or a mapping of their settings; one with an arm is a tank.

    Raises:
        ValueError: it is neither, or a setting is not valid.
    """
    if isinstance(value, Mapping):
        value = (Tank if "arm" in value else Panels).from_dict(value)
    if not isinstance(value, Appendages):
        raise ValueError(f"appendages must be Panels, a Tank or a mapping of their settings, got {value!r}")
    return value


def _check(satellite: Satellite, *names: str) -> None:
    missing = [name for name in names if getattr(satellite, name) is None]
    if missing:
        raise ValueError(f"satellite {satellite.name!r} needs {' and '.join(missing)} to place its appendages by")
