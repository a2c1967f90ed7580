"""Templates of episodes: the core's records of truth, belief and task, built from a problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from satid_gym.core.records import Criterion, InertiaMode, ObservationForm, Templates, concatenate
from satid_gym.core.task import task_dtype
from satid_gym.core.truth.records import draw_dtype
from satid_gym.core.truth.star_tracker import SEES_ALL
from satid_gym.disturbance import Disturbance
from satid_gym.estimators.inertia import products_of_inertia
from satid_gym.estimators.records import new_belief
from satid_gym.faults import Faults
from satid_gym.law_ranges import LawRanges
from satid_gym.laws import INERTIA_MODES, MASS_MODES, TABLE, InertiaLaw
from satid_gym.operations import SLEW_MAX, Operations
from satid_gym.oscillators import Oscillator, oscillator_count, oscillator_counts
from satid_gym.plants import new_plant
from satid_gym.policy import Mission, missions
from satid_gym.problem import Problem
from satid_gym.reward import NUMBERS
from satid_gym.rigid_body import inertia_tensor
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.sensors import Sensors
from satid_gym.star_tracker import StarTracker, earth_angle
from satid_gym.tracking import write_tracking


@dataclass(frozen=True)
class EpisodeTemplates:
    """Templates of a problem, one row a satellite."""

    satellites: tuple[Satellite, ...]
    records: Templates


def build_templates(p: Problem, inertia: np.ndarray | None = None, room: int = 1) -> EpisodeTemplates:
    """Templates of a problem, with room for at least `room` knots; a true `inertia` replaces the drawn one.

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
    plants = new_plant(true, law, disturbance, room, scenario.faults.torque_delay[1])
    plant = plants[0]
    if isinstance(p.inertia, str) and p.inertia in MASS_MODES:
        plant["law"] = InertiaMode[p.inertia.upper()]
    plant["torque_noise_std"] = scenario.torque_noise * operating.wheels.max_torque
    plant["torque_lag"] = scenario.torque_lag
    plant["gyro_noise_std"], plant["gyro_bias_walk"] = operating.gyro_noise_std, scenario.gyro_bias_walk
    plant["tachometer_noise_std"] = operating.tachometer_noise_std
    _write_sampling(plant["sampling"], operating.sensors, scenario.sample_period)
    if operating.sensors.star_tracker is not None:
        write_tracker(plant["tracker"], operating.sensors.star_tracker, scenario)
    if scenario.operations is not None:
        _write_operations(plant["operations"], scenario.operations, operating.rate_limit)
    plant["gyro_outlier"] = scenario.faults.gyro_outlier
    plant["gyro_outlier_size"] = np.multiply(operating.gyro_noise_std, scenario.faults.gyro_outlier_size)
    beliefs = new_belief(mission.prior, mission.estimator)
    tasks = _task(p, operating, mission.prior.inertia)
    draws = _draw(p, operating, law, room)
    if inertia is not None:
        draws["inertia_std"] = draws["tilt_std"] = 0.0
    return draws, plants, beliefs, tasks


def _write_sampling(row: np.void, sensors: Sensors, period: float) -> None:
    row["on"], row["period"] = sensors.are_timed, period
    row["gyro_range"] = sensors.gyro_range or 0.0
    row["pulse"] = 2.0 * np.pi / sensors.encoder_pulses if sensors.encoder_pulses is not None else 0.0
    for name in ("gyro_integrates", "gyro_delay", "gyro_quantum", "tachometer_delay"):
        row[name] = getattr(sensors, name)


def write_tracker(row: np.void, tracker: StarTracker, scenario: Scenario) -> None:
    """Write a data sheet to a record of `core.truth.star_tracker.tracker_dtype`."""
    row["on"], row["every"] = 1, tracker.samples(scenario.sample_period)
    for name in ("boresight", "across_std", "round_std", "reacquire"):
        row[name] = getattr(tracker, name)
    row["rate_limit"] = np.inf if tracker.rate_limit is None else tracker.rate_limit
    row["sun_cosine"] = SEES_ALL if tracker.sun_exclusion is None else np.cos(tracker.sun_exclusion)
    blinded = tracker.earth_exclusion
    row["earth_cosine"] = SEES_ALL if blinded is None else np.cos(earth_angle(scenario.orbit_rate) + blinded)


def _write_operations(row: np.void, operations: Operations, rate_limit: float) -> None:
    row["on"], row["boresight"] = 1, operations.boresight
    row["gap"], row["window"] = operations.gap, operations.window
    row["slew"], row["slew_max"] = rate_limit * np.array(operations.slew), SLEW_MAX
    _write_window_limits(row, operations)
    row["keep_out_cosine"] = np.cos(operations.keep_out) if operations.keep_out > 0.0 else SEES_ALL
    row["clear_cosine"] = np.cos(operations.keep_out + operations.clearance)


def _write_window_limits(row: np.void, operations: Operations) -> None:
    row["pointing_cosine"], row["steadiness"] = np.cos(operations.pointing), operations.steadiness


def _task(p: Problem, satellite: Satellite, prior: np.ndarray) -> np.ndarray:
    scenario, reward = p.scenario, p.reward
    rows = np.zeros(1, task_dtype(satellite.wheels.count, oscillator_count(satellite.oscillators)))
    task = rows[0]
    task["sample_period"], task["samples"] = scenario.sample_period, scenario.samples
    task["decisions"], task["observation"] = scenario.decisions, ObservationForm[p.observation.upper()]
    task["tells_walk"] = p.include_walk
    task["tells_sun"], task["tells_earth"] = p.tells_sky
    if scenario.operations is not None:
        task["tells_window"], task["payload"] = 1, scenario.operations.boresight
        _write_window_limits(task, scenario.operations)
    task["orbit_rate"] = scenario.orbit_rate
    wheels = satellite.wheels
    task["torque_max"], task["wheel_speed_max"] = wheels.max_torque, wheels.max_speed
    task["rate_limit"] = satellite.rate_limit
    task["termination_rate"] = scenario.termination_factor * satellite.rate_limit
    limits = [np.inf if o.deflection_limit is None else o.deflection_limit for o in satellite.oscillators]
    task["deflection_limit"] = np.repeat(limits, oscillator_counts(satellite.oscillators))
    task["termination_deflection"] = scenario.deflection_factor * task["deflection_limit"]
    task["control_authority"] = wheels.torque_reach * scenario.decision_period / np.diag(prior) / satellite.rate_limit
    task["momentum_fraction"] = np.diag(prior) * satellite.rate_limit / wheels.momentum_reach
    task["criterion"], task["net"] = Criterion[reward.criterion.upper()], reward.net
    for name in NUMBERS:
        task[name] = getattr(reward, name)
    write_tracking(task["tracking"], p, satellite, prior)
    return rows


def _draw(p: Problem, satellite: Satellite, law: InertiaLaw | None, room: int) -> np.ndarray:
    scenario = p.scenario
    room = max(room, law.room if law is not None else 1)
    rows = np.zeros(1, draw_dtype(room, oscillator_count(satellite.oscillators)))
    draw = rows[0]
    _write_oscillator_draws(draw, satellite.oscillators)
    draw["inertia_std"], draw["tilt_std"] = scenario.inertia_std, scenario.tilt_std
    draw["wheel_speed_range"] = scenario.wheel_speed_range
    draw["rate_std"] = scenario.initial_rate_std * satellite.rate_limit
    draw["disturbance_std"] = satellite.disturbance_std
    draw["attitude_random"] = scenario.random_attitude
    if law is None:
        modes = INERTIA_MODES if p.inertia == "random" else (p.inertia,)
        draw["law_probability"] = [(mode in modes) / len(modes) for mode in INERTIA_MODES]
        _write_ranges(draw, scenario.laws, scenario.horizon)
        if isinstance(p.inertia, str) and p.inertia in MASS_MODES:
            _write_mass_ranges(draw, scenario.laws, scenario.horizon, p.inertia)
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


def _write_mass_ranges(draw: np.void, laws: LawRanges, horizon: float, mode: str) -> None:
    size = {"deployment": laws.deployment_size, "fuel": laws.fuel_size, "release": laws.release_size}
    time = {"deployment": laws.deployment_time, "fuel": (1.0, 1.0), "release": laws.release_time}
    draw["mass_size"], draw["law_duration"] = size[mode], laws.deployment_duration
    draw["law_time"][:] = [horizon * x for x in time[mode]]


def _write_oscillator_draws(row: np.void, oscillators: Sequence[Oscillator]) -> None:
    """Write how far the true oscillators may be off nominal to a record of `core.truth.records.draw_dtype`."""
    i = 0
    for o in oscillators:
        for twin in [i] * o.count:
            row["oscillator_mass"][i], row["oscillator_frequency"][i] = o.mass_std, o.frequency_std
            row["oscillator_damping"][i], row["oscillator_twin"][i] = o.damping_std, twin
            row["oscillator_deflection"][i] = o.deflection_std
            i += 1
