"""Templates of episodes: the core's records of truth, belief and task, built from a problem."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from satid_gym.core import kernels
from satid_gym.core.records import Criterion, InertiaMode, Templates, concatenate, task_dtype
from satid_gym.core.truth.records import draw_dtype, plant_dtype
from satid_gym.disturbance import Disturbance
from satid_gym.estimators.inertia import products_of_inertia
from satid_gym.estimators.records import new_belief
from satid_gym.faults import Faults
from satid_gym.laws import INERTIA_MODES, TABLE, InertiaLaw, LawRanges
from satid_gym.policy import Mission, missions
from satid_gym.problem import Problem
from satid_gym.reward import NUMBERS
from satid_gym.satellite import Satellite, inertia_tensor


@dataclass(frozen=True)
class EpisodeTemplates:
    """Templates of a problem, one row a satellite."""

    satellites: tuple[Satellite, ...]
    records: Templates


def build_templates(p: Problem, inertia: np.ndarray | None = None, room: int = 1) -> EpisodeTemplates:
    """Templates of a problem, with room for so many knots or more; a true `inertia` replaces the drawn one.

    Raises:
        ValueError: `inertia` is no rigid body's, or has products that the problem's filter leaves out.
    """
    rows = [_template(p, mission, inertia, room) for mission in missions(p)]
    records = Templates(*map(concatenate, zip(*rows, strict=True)))
    records.tasks["template"] = np.arange(len(rows))
    return EpisodeTemplates(p.satellites, records)


def _template(p: Problem, mission: Mission, inertia: np.ndarray | None, room: int) -> tuple[np.ndarray, ...]:
    scenario, operating = p.scenario, mission.satellite
    law = p.inertia if isinstance(p.inertia, InertiaLaw) else None
    disturbance = Disturbance(
        gravity_gradient=scenario.gravity_gradient,
        solar_force=(scenario.solar_pressure, 0.0, 0.0),
        orbit_rate=scenario.orbit_rate,
    )
    true = operating if inertia is None else operating.replace(inertia=inertia_tensor(inertia, "true inertia"))
    if inertia is not None and (found := products_of_inertia(true.inertia, np.diag(true.inertia))):
        p.check_parameters(f"the true inertia has products of inertia about the body axes, {found}")
    plants = new_plant(true, law, disturbance, room)
    plant = plants[0]
    plant["torque_noise_std"] = scenario.torque_noise * operating.wheels.max_torque
    plant["torque_lag"] = scenario.torque_lag
    plant["gyro_noise_std"], plant["gyro_bias_walk"] = operating.gyro_noise_std, scenario.gyro_bias_walk
    plant["tachometer_noise_std"] = operating.tachometer_noise_std
    plant["gyro_outlier"] = scenario.faults.gyro_outlier
    plant["gyro_outlier_size"] = np.multiply(operating.gyro_noise_std, scenario.faults.gyro_outlier_size)
    beliefs = new_belief(mission.prior, mission.estimator)
    tasks = _task(p, operating, mission.prior.inertia)
    draws = _draw(p, operating, law, room)
    if inertia is not None:
        draws["inertia_std"] = draws["tilt_std"] = 0.0
    return draws, plants, beliefs, tasks


def _task(p: Problem, satellite: Satellite, prior: np.ndarray) -> np.ndarray:
    scenario, reward = p.scenario, p.reward
    rows = np.zeros(1, task_dtype(satellite.wheels.count))
    task = rows[0]
    task["sample_period"], task["samples"] = scenario.sample_period, scenario.samples
    task["decisions"] = scenario.decisions
    task["torque_max"], task["wheel_speed_max"] = satellite.wheels.max_torque, satellite.wheels.max_speed
    task["rate_limit"] = satellite.rate_limit
    task["termination_rate"] = scenario.termination_factor * satellite.rate_limit
    full = np.abs(satellite.wheels.axes) @ satellite.wheels.max_torque
    task["control_authority"] = full * scenario.decision_period / np.diag(prior) / satellite.rate_limit
    stored = np.abs(satellite.wheels.axes) @ (satellite.wheels.inertia * satellite.wheels.max_speed)
    task["momentum_fraction"] = np.diag(prior) * satellite.rate_limit / stored
    task["criterion"], task["net"] = Criterion[reward.criterion.upper()], reward.net
    for name in NUMBERS:
        task[name] = getattr(reward, name)
    return rows


def _draw(p: Problem, satellite: Satellite, law: InertiaLaw | None, room: int) -> np.ndarray:
    scenario = p.scenario
    rows = np.zeros(1, draw_dtype(max(room, law.room if law is not None else 1)))
    draw = rows[0]
    draw["inertia_std"], draw["tilt_std"] = scenario.inertia_std, scenario.tilt_std
    draw["wheel_speed_range"] = scenario.wheel_speed_range
    draw["rate_std"] = scenario.initial_rate_std * satellite.rate_limit
    draw["disturbance_std"] = satellite.disturbance_std
    draw["attitude_random"] = scenario.random_attitude
    if law is None:
        modes = INERTIA_MODES if p.inertia == "random" else (p.inertia,)
        draw["law_probability"] = [(mode in modes) / len(modes) for mode in INERTIA_MODES]
        _write_ranges(draw, scenario.laws, scenario.horizon)
    else:
        draw["law_probability"] = [mode == law.mode for mode in INERTIA_MODES]
        draw["law_size"], draw["law_time"] = law.size, law.time
        draw["law_frequency"], draw["law_phase"] = law.frequency, law.phase
        draw["change_given"] = not law.relative
        if law.mode == TABLE and law.relative:
            assert law.values is not None
            draw["knot_size"][: len(law.values)] = law.values - 1.0
    for tolerance in fields(satellite.tolerances):
        draw[f"tolerance_{tolerance.name}"] = getattr(satellite.tolerances, tolerance.name)
    _write_faults(draw, scenario.faults, scenario.horizon)
    return rows


def _write_faults(draw: np.void, faults: Faults, horizon: float) -> None:
    """Faults that are drawn for an episode; each field has the name of its setting."""
    draw["faulty"] = faults.possible
    draw["fault_time"] = [horizon * x for x in faults.time]
    for field in fields(faults):
        if field.name in (draw.dtype.names or ()):
            draw[field.name] = getattr(faults, field.name)


def _write_ranges(draw: np.void, laws: LawRanges, horizon: float) -> None:
    static, one = (0.0, 0.0), (horizon, horizon)
    draw["law_size"] = [static, laws.step_size, laws.drift_size, laws.periodic_size]
    draw["law_time"] = [one, [horizon * x for x in laws.step_time], one, one]
    draw["law_frequency"], draw["law_phase"] = laws.frequency, laws.phase


def new_plant(
    satellite: Satellite, law: InertiaLaw | None = None, disturbance: Disturbance | None = None, room: int = 1
) -> np.ndarray:
    """One row of truth at rest at time 0: the satellite as nominal, without noise; room for so many knots or more.

    Raises:
        ValueError: the law would make the inertia unphysical on its way.
    """
    wheels, law, disturbance = satellite.wheels, law or InertiaLaw("static"), disturbance or Disturbance()
    rows = np.zeros(1, plant_dtype(wheels.count, max(room, law.room)))
    row = rows[0]
    row["axes"], row["wheel_inertia"] = wheels.axes, wheels.inertia
    row["torque_max"], row["wheel_speed_max"] = wheels.max_torque, wheels.max_speed
    _write_law(row, law, satellite.inertia)
    row["stepped"] = law.mode == "step" and law.time <= 0.0
    _check_law(satellite, law, row["change"])
    for name in ("solar_force", "solar_offset"):
        row[name] = getattr(disturbance, name)
    row["torque_constant"], row["torque_cosine"] = disturbance.constant, disturbance.cosine
    row["torque_sine"] = disturbance.sine
    row["orbit_rate"], row["gravity_gradient"] = disturbance.orbit_rate, disturbance.gravity_gradient
    row["attitude"] = 0.0, 0.0, 0.0, 1.0
    return rows


def _write_law(row: np.void, law: InertiaLaw, inertia: np.ndarray) -> None:
    row["inertia"], row["law"] = inertia, InertiaMode[law.mode.upper()]
    row["law_time"], row["law_frequency"], row["law_phase"] = law.time, law.frequency, law.phase
    if law.mode != TABLE:
        row["change"] = law.size * inertia if law.change is None else law.change
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
    times = np.atleast_1d(np.asarray(times, dtype=np.float64))
    rows = np.zeros(1, plant_dtype(3, law.room))
    _write_law(rows[0], law, inertia_tensor(inertia))
    out = np.empty((len(times), 3, 3))
    kernels.law_inertia(rows, times, out)
    return out
