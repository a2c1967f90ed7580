"""Modes of a satellite's oscillators, as a filter expects them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number, real_array
from satid_gym.core.truth.oscillators import SHARE_LEFT_MIN
from satid_gym.oscillators import Oscillator
from satid_gym.rigid_body import point_inertia

_DAMPING_MAX = 1.0  # critical: beyond it a mode does not oscillate


@dataclass(frozen=True, eq=False, kw_only=True)
class Mode(Config):
    """Mode that a filter expects, in a coordinate eta of unit modal mass.

    M = (J + inertia_slope eta + inertia_curvature eta^2) omega + A j Omega + coupling d eta/dt.

    Attributes:
        coupling: (3,) kg^(1/2) m; coupling_i^2 / J_ii is the mode's share of an axis's inertia.
        frequency: Hz, of a body that does not rotate.
        damping: damping ratio of the same.
        inertia_slope: (3, 3) derivative of the inertia by deflection, kg^(1/2) m.
        inertia_curvature: (3, 3) half of its second derivative.
        coupling_std: std of the logarithm of the coupling.
        frequency_std: std of the logarithm of the frequency.
        damping_std: std of the logarithm of the damping ratio.
        deflection_limit: of eta at nominal mass, kg^(1/2) m; None: no limit.
        deflection_std: std of the first deflection eta, kg^(1/2) m; that of its rate is w times as large.

    Raises:
        ValueError: a value is out of range.
    """

    coupling: np.ndarray
    frequency: float
    damping: float
    inertia_slope: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    inertia_curvature: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    coupling_std: float = 0.0
    frequency_std: float = 0.0
    damping_std: float = 0.0
    deflection_std: float = 0.0
    deflection_limit: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "coupling", real_array("mode coupling", self.coupling, (3,)))
        for name in ("inertia_slope", "inertia_curvature"):
            object.__setattr__(self, name, real_array(f"mode {name}", getattr(self, name), (3, 3)))
        check_number("mode frequency", self.frequency, strict=True)
        check_number("mode damping", self.damping, high=_DAMPING_MAX)
        for name in ("coupling_std", "frequency_std", "damping_std", "deflection_std"):
            check_number(f"mode {name}", getattr(self, name))
        if self.deflection_limit is not None:
            check_number("mode deflection_limit", self.deflection_limit, strict=True)


def modes_of(value: object) -> tuple[Mode, ...]:
    """Modes, or mappings of their settings, as a tuple.

    Raises:
        ValueError: one is neither, or a setting is not valid.
    """
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ValueError(f"modes must be a list of Mode, got {value!r}")
    found = [Mode.from_dict(item) if isinstance(item, Mapping) else item for item in value]
    for item in found:
        if not isinstance(item, Mode):
            raise ValueError(f"a mode must be a Mode or a mapping of its settings, got {item!r}")
    return tuple(found)


def mode_of(oscillator: Oscillator, total_mass: float | None) -> Mode:
    """Mode of an oscillator; of a mirrored pair the one that rotates the body without translating it.

    Args:
        oscillator: the oscillator.
        total_mass: of the satellite, kg; None: its centre of mass stays.
    """
    o = oscillator
    momentum, inertance = o.mass * o.tangent, o.inertance
    coupling, slope = np.cross(o.place, momentum) + o.spin, o.inertia_slope
    moved, curvature = inertance, np.array(o.inertia_curvature)
    if o.mirrored:
        coupling, slope = np.sqrt(2.0) * coupling, np.sqrt(2.0) * slope
    elif total_mass is not None:
        moved = inertance - float(momentum @ momentum) / total_mass
        curvature = curvature - point_inertia(momentum) / total_mass
    return Mode(
        coupling=coupling / np.sqrt(moved),
        frequency=o.frequency * float(np.sqrt(inertance / moved)),
        damping=o.damping * float(np.sqrt(inertance / moved)),
        inertia_slope=slope / np.sqrt(moved),
        inertia_curvature=curvature / moved,
        coupling_std=0.5 * o.mass_std,
        frequency_std=o.frequency_std,
        damping_std=o.damping_std,
        deflection_std=o.deflection_std * float(np.sqrt(moved)),
        deflection_limit=None if o.deflection_limit is None else o.deflection_limit * float(np.sqrt(o.count * moved)),
    )


def fastest_oscillation(modes: Sequence[Mode], inertia: np.ndarray) -> float:
    """Upper bound of the frequencies on the free body, rad/s; they exceed those of a body held.

    Args:
        modes: the modes.
        inertia: of the satellite (3, 3), kg m^2.
    """
    J_inv = np.linalg.inv(inertia)
    share = sum(float(m.coupling @ J_inv @ m.coupling) for m in modes)
    fastest = max((m.frequency for m in modes), default=0.0)
    return 2.0 * np.pi * fastest / float(np.sqrt(max(1.0 - share, SHARE_LEFT_MIN)))


def check_sampling(name: str, modes: Sequence[Mode], inertia: np.ndarray, sample_period: float) -> None:
    """Refuse modes that the samples cannot follow.

    Args:
        name: of the satellite.
        modes: its modes.
        inertia: of the satellite (3, 3), kg m^2.
        sample_period: s.

    Raises:
        ValueError: a mode is at or above half the sampling rate.
    """
    fastest, nyquist = fastest_oscillation(modes, inertia) / (2.0 * np.pi), 0.5 / sample_period
    if fastest >= nyquist:
        raise ValueError(
            f"the oscillators of satellite {name!r} reach {fastest:.3g} Hz on the free body, which must be below half "
            f"the sampling rate, {nyquist:g} Hz: give a shorter sample_period, or leave such a mode out"
        )
