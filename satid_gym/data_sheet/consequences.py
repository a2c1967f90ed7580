"""Figures that follow from a data sheet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.modes import fastest_oscillation, mode_of
from satid_gym.oscillators import Oscillator, Panel
from satid_gym.satellite import Satellite

_STEP = 2.0  # peak over static deflection of an undamped mode after a step of the torque


@dataclass(frozen=True, eq=False)
class DerivedMode:
    """What follows from a panel or a slosh mass, alone on the satellite; of a mirrored pair, from both.

    Attributes:
        kind: "panel", "slosh mass" or "pair of" either.
        unit: of its deflection, "rad" or "m".
        held: natural frequency with the body held still, Hz.
        free: the same with the body free to turn, Hz.
        share: (3,) of the moment about each body axis that moves with the mode and not with the body.
        deflection: largest after a step from no torque to all of the wheels' about one axis, from rest, without
            damping; the axis is the one with the largest.
        limit: of the deflection; None: none is given.
    """

    kind: str
    unit: str
    held: float
    free: float
    share: np.ndarray
    deflection: float
    limit: float | None


@dataclass(frozen=True, eq=False)
class Derived:
    """What follows from a data sheet, about each body axis.

    Attributes:
        moment: (3,) diagonal of the inertia, kg m^2.
        torque: (3,) of all wheels together, N m.
        to_limit: (3,) s from rest to the rate limit at that torque.
        reached: (3,) rad/s at which the body turns once the wheels, from rest, are at their speed limit.
        box: (3,) moment over that of a uniform box of the same mass and size; None where these are not given.
        spin_up: (n,) s of each wheel from rest to its speed limit.
        modes: of each of the oscillators.
    """

    moment: np.ndarray
    torque: np.ndarray
    to_limit: np.ndarray
    reached: np.ndarray
    box: np.ndarray | None
    spin_up: np.ndarray
    modes: tuple[DerivedMode, ...]


def derived(satellite: Satellite) -> Derived:
    """What follows from a data sheet."""
    wheels, moment = satellite.wheels, np.diag(satellite.inertia)
    box = None
    if satellite.mass is not None and satellite.size is not None:
        square = satellite.size**2
        box = 12.0 * moment / (satellite.mass * (square.sum() - square))
    return Derived(
        moment=moment,
        torque=wheels.torque_reach,
        to_limit=satellite.rate_limit * moment / wheels.torque_reach,
        reached=wheels.momentum_reach / moment,
        box=box,
        spin_up=wheels.max_momentum / wheels.max_torque,
        modes=tuple(_derived_mode(satellite, o) for o in satellite.oscillators),
    )


def _derived_mode(satellite: Satellite, oscillator: Oscillator) -> DerivedMode:
    """Of one mode eta: J alpha + c eta'' = torque and (1 - c^T J^-1 c) eta'' + w^2 eta = -c^T J^-1 torque."""
    unit = oscillator.replace(deflection_limit=1.0)
    mode = mode_of(unit, satellite.mass)
    assert mode.deflection_limit is not None  # eta at a deflection of 1
    pull = np.linalg.solve(satellite.inertia, mode.coupling)
    static = np.abs(pull * satellite.wheels.torque_reach).max() / (2.0 * np.pi * mode.frequency) ** 2
    what, measure = ("panel", "rad") if isinstance(oscillator, Panel) else ("slosh mass", "m")
    return DerivedMode(
        kind=f"pair of {what}{'es' if what.endswith('mass') else 's'}" if oscillator.mirrored else what,
        unit=measure,
        held=oscillator.frequency,
        free=fastest_oscillation([mode], satellite.inertia) / (2.0 * np.pi),
        share=mode.coupling**2 / np.diag(satellite.inertia),
        deflection=_STEP * float(static) / mode.deflection_limit,
        limit=oscillator.deflection_limit,
    )
