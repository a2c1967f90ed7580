"""Oscillators of a data sheet: hinged panels and slosh masses."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number, real_array
from satid_gym.rigid_body import part_inertia, point_inertia, turn_slope

OSCILLATORS_MAX = 8  # of a satellite, the two of a mirrored pair counted apart
_UNIT_TOLERANCE = 1e-6  # of a direction, whose length must be 1
_OWN = (("hinge", "axis", "arm"), ("position", "direction"))  # names that only panels, only slosh masses have
DAMPING_MAX, _LOG_STD_MAX = 0.5, 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class Oscillator(Config, abc.ABC):
    """Base class of panels and slosh masses, which move relative to the body on a linear spring and damper.

    Attributes:
        mass: kg.
        frequency: natural frequency with the body held still, Hz.
        damping: damping ratio of the same.
        mass_std: std of the logarithm of the true mass (and inertia) about the nominal one.
        frequency_std: std of the logarithm of the true frequency.
        damping_std: std of the logarithm of the true damping ratio.
        deflection_std: std of the initial deflection, rad for a panel, m for a slosh mass; 0: it starts at rest.
        deflection_limit: rad or m; beyond it there are a cost and a penalty, far beyond it the end; None: no limit.
        mirrored: whether there is a second, identical one, mirrored at the centre of mass; a filter models only the
            mode of the pair that turns the body.

    Raises:
        ValueError: a value is out of range.
    """

    mass: float
    frequency: float
    damping: float
    mass_std: float = 0.0
    frequency_std: float = 0.0
    damping_std: float = 0.0
    deflection_std: float = 0.0
    deflection_limit: float | None = None
    mirrored: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("oscillator mass", self.mass, strict=True)
        check_number("oscillator frequency", self.frequency, strict=True)
        check_number("oscillator damping", self.damping, high=DAMPING_MAX)
        for name in ("mass_std", "frequency_std", "damping_std"):
            check_number(name, getattr(self, name), high=_LOG_STD_MAX)
        check_number("deflection_std", self.deflection_std)
        if self.deflection_limit is not None:
            check_number("deflection_limit", self.deflection_limit, strict=True)

    @property
    def count(self) -> int:
        """Number of oscillators: 2 where mirrored."""
        return 2 if self.mirrored else 1

    @property
    @abc.abstractmethod
    def place(self) -> np.ndarray:
        """Centre of mass at rest (3,), m, from the satellite's."""

    @property
    @abc.abstractmethod
    def tangent(self) -> np.ndarray:
        """Motion of the centre of mass by coordinate at rest, (3,)."""

    @property
    def spin(self) -> np.ndarray:
        """Angular momentum about its own centre of mass by rate of the coordinate, (3,)."""
        return np.zeros(3)

    @property
    def inertia_slope(self) -> np.ndarray:
        """Derivative of the satellite's inertia by the coordinate at rest (3, 3)."""
        across = np.outer(self.place, self.tangent)
        return self.mass * (2.0 * np.trace(across) * np.eye(3) - across - across.T)

    @property
    def inertia_curvature(self) -> np.ndarray:
        """Half of its second derivative (3, 3), the centre of mass held."""
        return self.mass * point_inertia(self.tangent)

    @property
    @abc.abstractmethod
    def inertance(self) -> float:
        """Mass or inertia that the spring moves with the body held still: kg of a mass, kg m^2 of a panel."""

    @property
    def inertia_at_rest(self) -> np.ndarray:
        """Share of the satellite's inertia about its centre of mass (3, 3), kg m^2, of a pair both."""
        return self.count * self.mass * point_inertia(self.place)


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel(Oscillator):
    """Rigid panel on a hinge with a spring: the first bending mode of a solar array, boom or antenna.

    Its coordinate is the angle of deflection, rad. All vectors are in the body frame, at rest.

    Attributes:
        hinge: (3,) from the satellite's centre of mass to the hinge, m.
        axis: (3,) unit vector along the hinge.
        arm: (3,) from the hinge to the panel's centre of mass, m.
        inertia: about its own centre of mass, kg m^2; (3,) principal moments along the body axes or (3, 3); 0: a point.

    Raises:
        ValueError: a value is out of range, or the arm lies along the hinge and the panel has no inertia about it.
    """

    hinge: np.ndarray
    axis: np.ndarray
    arm: np.ndarray
    inertia: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "hinge", real_array("panel hinge", self.hinge, (3,)))
        object.__setattr__(self, "arm", real_array("panel arm", self.arm, (3,)))
        object.__setattr__(self, "axis", _unit("panel axis", self.axis))
        object.__setattr__(self, "inertia", part_inertia("panel inertia", self.inertia))
        if self.inertance <= 0.0:
            raise ValueError("a panel needs inertia about its hinge: give an arm across the axis, or an inertia")

    @property
    def place(self) -> np.ndarray:
        """Centre of mass at rest (3,), m, from the satellite's."""
        return self.hinge + self.arm

    @property
    def tangent(self) -> np.ndarray:
        """Motion of the centre of mass by angle at rest, (3,) m."""
        return np.cross(self.axis, self.arm)

    @property
    def spin(self) -> np.ndarray:
        """Angular momentum about its own centre of mass by rate of the angle, (3,) kg m^2."""
        return self.inertia @ self.axis

    @property
    def inertia_slope(self) -> np.ndarray:
        """Derivative of the satellite's inertia by the angle at rest (3, 3), kg m^2."""
        return super().inertia_slope + turn_slope(self.axis, self.inertia)

    @property
    def inertia_curvature(self) -> np.ndarray:
        """Half of its second derivative (3, 3), kg m^2, the centre of mass held."""
        x, curvature = self.place, np.cross(self.axis, self.tangent)
        across = np.outer(x, curvature)
        turned = turn_slope(self.axis, turn_slope(self.axis, self.inertia))
        bent = self.mass * (2.0 * np.trace(across) * np.eye(3) - across - across.T)
        return super().inertia_curvature + 0.5 * (bent + turned)

    @property
    def inertance(self) -> float:
        """Inertia about the hinge, kg m^2."""
        return float(self.mass * self.tangent @ self.tangent + self.axis @ self.inertia @ self.axis)

    @property
    def inertia_at_rest(self) -> np.ndarray:
        """Share of the satellite's inertia about its centre of mass (3, 3), kg m^2, of a pair both."""
        return super().inertia_at_rest + self.count * self.inertia


@dataclass(frozen=True, eq=False, kw_only=True)
class SloshMass(Oscillator):
    """Particle on a spring along a direction: the first sloshing mode of a tank.

    Its coordinate is the travel, m. Both vectors are in the body frame.

    Attributes:
        position: (3,) of the particle at rest from the satellite's centre of mass, m.
        direction: (3,) unit vector along which it moves.

    Raises:
        ValueError: a value is out of range.
    """

    position: np.ndarray
    direction: np.ndarray

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "position", real_array("slosh position", self.position, (3,)))
        object.__setattr__(self, "direction", _unit("slosh direction", self.direction))

    @property
    def place(self) -> np.ndarray:
        """Position at rest (3,), m."""
        return self.position

    @property
    def tangent(self) -> np.ndarray:
        """Direction (3,)."""
        return self.direction

    @property
    def inertance(self) -> float:
        """Mass, kg."""
        return self.mass


def oscillator_counts(oscillators: Sequence[Oscillator]) -> tuple[int, ...]:
    """Number of oscillators that each stands for: 2 if mirrored."""
    return tuple(o.count for o in oscillators)


def oscillator_count(oscillators: Sequence[Oscillator]) -> int:
    """Number of oscillators, the two of a mirrored pair counted apart."""
    return sum(oscillator_counts(oscillators))


def _unit(name: str, value: object) -> np.ndarray:
    vector = real_array(name, value, (3,))
    length = np.linalg.norm(vector)
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"{name} must be a unit vector, got {vector.tolist()} of length {length:g}: divide by it")
    return real_array(name, vector / length)


def oscillators_of(value: object) -> tuple[Oscillator, ...]:
    """Panels and slosh masses, or mappings of their settings, as a tuple; a mapping is what most of its names are of.

    Raises:
        ValueError: one is neither, a setting is not valid, or there are more than 8.
    """
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ValueError(f"oscillators must be a list of Panel and SloshMass, got {value!r}")
    found = []
    for item in value:
        if isinstance(item, Mapping):
            panel, slosh = (sum(name in item for name in own) for own in _OWN)
            if panel == slosh == 0:
                has = f"has {', '.join(_OWN[0])}, a slosh mass {' and '.join(_OWN[1])}"
                raise ValueError(f"an oscillator is a panel or a slosh mass: a panel {has}; got {list(item)}")
            item = (Panel if panel >= slosh else SloshMass).from_dict(item)
        if not isinstance(item, Oscillator):
            raise ValueError(f"an oscillator must be a Panel, a SloshMass or a mapping of its settings, got {item!r}")
        found.append(item)
    if (count := oscillator_count(found)) > OSCILLATORS_MAX:
        raise ValueError(f"a satellite has at most {OSCILLATORS_MAX} oscillators, mirrored count twice; got {count}")
    return tuple(found)
