"""The core's plant record, built from a satellite, a law and a disturbance."""

from __future__ import annotations

import numpy as np

from satid_gym.core import kernels
from satid_gym.core.records import plant_dtype
from satid_gym.disturbance import Disturbance
from satid_gym.laws import INERTIA_MODES, InertiaLaw
from satid_gym.satellite import Satellite, inertia_tensor


def new_plant(
    satellite: Satellite, law: InertiaLaw | None = None, disturbance: Disturbance | None = None
) -> np.ndarray:
    """One row of truth at rest at time 0: the satellite as nominal, without noise.

    Raises:
        ValueError: the law would make the inertia unphysical on its way.
    """
    wheels, law, disturbance = satellite.wheels, law or InertiaLaw("static"), disturbance or Disturbance()
    rows = np.zeros(1, plant_dtype(wheels.count))
    row = rows[0]
    row["axes"], row["wheel_inertia"] = wheels.axes, wheels.inertia
    row["torque_max"], row["wheel_speed_max"] = wheels.max_torque, wheels.max_speed
    row["inertia"] = satellite.inertia
    row["law"] = INERTIA_MODES.index(law.mode)
    row["change"] = law.size * satellite.inertia if law.change is None else law.change
    row["law_time"], row["law_frequency"], row["law_phase"] = law.time, law.frequency, law.phase
    row["stepped"] = law.mode == "step" and law.time <= 0.0
    _check_law(satellite, law, row["change"])
    for name in ("solar_force", "solar_offset"):
        row[name] = getattr(disturbance, name)
    row["torque_constant"], row["torque_cosine"] = disturbance.constant, disturbance.cosine
    row["torque_sine"] = disturbance.sine
    row["orbit_rate"], row["gravity_gradient"] = disturbance.orbit_rate, disturbance.gravity_gradient
    row["attitude"] = 0.0, 0.0, 0.0, 1.0
    return rows


def _check_law(satellite: Satellite, law: InertiaLaw, change: np.ndarray) -> None:
    """The physical tensors are a convex cone, so the ends of the law decide for all between."""
    factors = {"static": (), "step": (1.0,), "drift": (1.0,), "periodic": (-1.0, 1.0)}[law.mode]
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
    tensor = inertia_tensor(inertia)
    times = np.atleast_1d(np.asarray(times, dtype=np.float64))
    rows = np.zeros(1, plant_dtype(3))
    row = rows[0]
    row["inertia"], row["law"] = tensor, INERTIA_MODES.index(law.mode)
    row["change"] = law.size * tensor if law.change is None else law.change
    row["law_time"], row["law_frequency"], row["law_phase"] = law.time, law.frequency, law.phase
    out = np.empty((len(times), 3, 3))
    kernels.law_inertia(rows, times, out)
    return out
