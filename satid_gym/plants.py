"""Plants: records of the truth for the core, built from a satellite, an inertia law and a disturbance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.core import kernels
from satid_gym.core.records import InertiaMode
from satid_gym.core.truth.records import plant_dtype
from satid_gym.disturbance import Disturbance
from satid_gym.laws import TABLE, InertiaLaw
from satid_gym.oscillators import Oscillator, Panel, SloshMass, oscillator_count
from satid_gym.rigid_body import inertia_tensor
from satid_gym.satellite import Satellite


def new_plant(
    satellite: Satellite,
    law: InertiaLaw | None = None,
    disturbance: Disturbance | None = None,
    room: int = 1,
    delay: int = 0,
) -> np.ndarray:
    """One row of truth at rest at time 0: the satellite as nominal, without noise.

    Args:
        satellite, law, disturbance: what it is made of.
        room: least number of knots of a law for which there is room.
        delay: largest delay of commands, in samples, for which there is room.

    Raises:
        ValueError: the law would make the inertia unphysical on its way.
    """
    wheels, law, disturbance = satellite.wheels, law or InertiaLaw("static"), disturbance or Disturbance()
    count, lines = oscillator_count(satellite.oscillators), satellite.sensors.lines
    rows = np.zeros(1, plant_dtype(wheels.count, max(room, law.room), count, lines, delay))
    row = rows[0]
    _write_oscillators(row["oscillators"], satellite.oscillators, satellite.mass)
    row["axes"], row["wheel_inertia"] = wheels.axes, wheels.inertia
    row["torque_max"], row["wheel_speed_max"] = wheels.max_torque, wheels.max_speed
    friction, row["rubs"] = wheels.friction, wheels.friction.acts
    row["friction_coulomb"], row["friction_static"] = friction.coulomb, friction.breakaway
    row["friction_viscous"], row["stribeck_speed"] = friction.viscous, friction.stribeck_speed
    row["avoided_speed"] = wheels.avoided_speed
    _write_law(row, law, satellite.inertia)
    row["stepped"] = law.mode in ("step", "release") and law.time <= 0.0
    _check_law(satellite, law, row["change"])
    for name in ("solar_force", "solar_offset"):
        row[name] = getattr(disturbance, name)
    row["torque_constant"], row["torque_cosine"] = disturbance.constant, disturbance.cosine
    row["torque_sine"] = disturbance.sine
    row["orbit_rate"], row["gravity_gradient"] = disturbance.orbit_rate, disturbance.gravity_gradient
    row["attitude"] = 0.0, 0.0, 0.0, 1.0
    return rows


def _write_oscillators(row: np.void, oscillators: Sequence[Oscillator], total_mass: float | None) -> None:
    """Write nominal oscillators, at rest, to the record of the truth.

    Args:
        row: of `satid_gym.core.truth.oscillator_geometry.oscillators_dtype`.
        oscillators: of the satellite.
        total_mass: of the satellite, kg; None: its centre of mass stays.
    """
    row["total_mass"] = np.inf if total_mass is None else total_mass
    i = 0
    for o in oscillators:
        rate, inertance = 2.0 * np.pi * o.frequency, o.inertance
        for side in (1.0, -1.0)[: o.count]:
            row["mass"][i], row["stiffness"][i] = o.mass, inertance * rate**2
            row["damping"][i] = 2.0 * o.damping * rate * inertance
            if isinstance(o, Panel):
                row["rest"][i], row["arm"][i], row["direction"][i] = side * o.hinge, side * o.arm, o.axis
                row["inertia"][i], row["hinged"][i] = o.inertia, 1.0
            elif isinstance(o, SloshMass):
                row["rest"][i], row["direction"][i] = side * o.position, side * o.direction
            i += 1


def _write_law(row: np.void, law: InertiaLaw, inertia: np.ndarray) -> None:
    row["inertia"], row["law"] = inertia, InertiaMode[law.mode.upper()]
    row["law_time"], row["law_frequency"], row["law_phase"] = law.time, law.frequency, law.phase
    row["law_duration"] = law.duration
    if law.mode != TABLE:
        row["change"] = law.size * inertia if law.relative else law.changes[0]
        return
    changes = table_changes(law, inertia)
    row["knots"] = count = len(changes)
    row["knot_time"][:count] = law.times
    row["knot_change"][:count] = changes[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def table_changes(law: InertiaLaw, inertia: np.ndarray) -> np.ndarray:
    """J(t) - J0 at the knots of a table, (K, 3, 3) kg m^2."""
    assert law.values is not None
    if law.relative:
        return (law.values - 1.0)[:, None, None] * inertia
    return law.changes


def _check_law(satellite: Satellite, law: InertiaLaw, change: np.ndarray) -> None:
    """The physical tensors are a convex cone, so the ends or knots of the law decide for all between."""
    if law.times is not None:
        for time, own in zip(law.times, table_changes(law, satellite.inertia), strict=True):
            inertia_tensor(satellite.inertia + own, f"inertia of {satellite.name} at {time:g} s of its {law.label}")
        return
    factors = {"static": (), "periodic": (-1.0, 1.0)}.get(law.mode, (1.0,))
    for factor in factors:
        inertia_tensor(satellite.inertia + factor * change, f"inertia of {satellite.name} at the end of its {law.mode}")


def law_inertia(law: InertiaLaw, inertia: np.ndarray, times: np.ndarray) -> np.ndarray:
    """J(t) of a law.

    Args:
        law: the law.
        inertia: (3,) or (3, 3) J0, kg m^2.
        times: (N,) s.

    Returns:
        (N, 3, 3) kg m^2.
    """
    times = np.atleast_1d(np.asarray(times, dtype=np.float64))
    rows = np.zeros(1, plant_dtype(3, law.room))
    _write_law(rows[0], law, inertia_tensor(inertia))
    out = np.empty((len(times), 3, 3))
    kernels.law_inertia(rows, times, out)
    return out
