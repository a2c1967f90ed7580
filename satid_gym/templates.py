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
from satid_gym.estimators.prior import counting_std
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

_SETTLED = 4.5  # samples without a larger change, after which the rate loop learns from what a motor does
_PROMPT = 0.5  # likewise, after which it tests whether a motor's gain has jumped
_GAIN_STD, _FRICTION_STD = 0.16, 0.05  # what it believes at first of gain, and of friction over the torque limit
_RESERVE = 0.1  # of the largest swing of a wheel, room that the null motion keeps
_NOISE_MIN = 0.01  # of the torque limit
_NOISE_MARGIN = 3.0  # standard deviations of its noise by which a wheel's momentum stays below its limit


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
    row["pointing_cosine"], row["steadiness"] = np.cos(operations.pointing), operations.steadiness
    row["keep_out_cosine"] = np.cos(operations.keep_out) if operations.keep_out > 0.0 else SEES_ALL
    row["clear_cosine"] = np.cos(operations.keep_out + operations.clearance)


def _task(p: Problem, satellite: Satellite, prior: np.ndarray) -> np.ndarray:
    scenario, reward = p.scenario, p.reward
    rows = np.zeros(1, task_dtype(satellite.wheels.count, p.actions, oscillator_count(satellite.oscillators)))
    task = rows[0]
    task["sample_period"], task["samples"] = scenario.sample_period, scenario.samples
    task["decisions"], task["observation"] = scenario.decisions, ObservationForm[p.observation.upper()]
    task["tells_walk"] = p.include_walk
    task["tells_sun"], task["tells_earth"] = p.tells_sky
    if scenario.operations is not None:
        task["tells_window"], task["payload"] = 1, scenario.operations.boresight
    task["orbit_rate"] = scenario.orbit_rate
    task["torque_max"], task["wheel_speed_max"] = satellite.wheels.max_torque, satellite.wheels.max_speed
    task["rate_limit"] = satellite.rate_limit
    task["termination_rate"] = scenario.termination_factor * satellite.rate_limit
    limits = [np.inf if o.deflection_limit is None else o.deflection_limit for o in satellite.oscillators]
    task["deflection_limit"] = np.repeat(limits, oscillator_counts(satellite.oscillators))
    task["termination_deflection"] = scenario.deflection_factor * task["deflection_limit"]
    full = np.abs(satellite.wheels.axes) @ satellite.wheels.max_torque
    task["control_authority"] = full * scenario.decision_period / np.diag(prior) / satellite.rate_limit
    stored = np.abs(satellite.wheels.axes) @ (satellite.wheels.inertia * satellite.wheels.max_speed)
    task["momentum_fraction"] = np.diag(prior) * satellite.rate_limit / stored
    task["criterion"], task["net"] = Criterion[reward.criterion.upper()], reward.net
    for name in NUMBERS:
        task[name] = getattr(reward, name)
    _write_tracking(task["tracking"], p, satellite, prior)
    return rows


def _write_tracking(row: np.void, p: Problem, satellite: Satellite, prior: np.ndarray) -> None:
    wheels = satellite.wheels
    row["on"] = p.control == "rate"
    row["bandwidth"] = p.scenario.tracking_bandwidth
    row["slope"] = p.scenario.reference_slope * wheels.max_torque.min() / np.linalg.eigvalsh(satellite.inertia)[-1]
    row["allocation"], row["rotor_inertia"] = np.linalg.pinv(wheels.axes), wheels.rotor_inertia
    row["spin_max"] = np.maximum(wheels.inertia * wheels.max_speed - _momentum_noise(p.scenario, satellite), 0.0)
    late, sensors = 2.0 * p.scenario.command_lateness, satellite.sensors
    row["motors"]["settled"] = _SETTLED * p.scenario.sample_period + late
    row["motors"]["prompt"] = (_PROMPT + sensors.counts + sensors.tachometer_delay) * p.scenario.sample_period + late
    noise = np.maximum(_acceleration_noise(satellite, p.scenario), _NOISE_MIN)
    row["motors"]["noise"], row["motors"]["expected"] = noise, 1.0
    row["motors"]["prior"] = (noise[:, None] / [_GAIN_STD, _FRICTION_STD]) ** 2
    _write_null_motion(row["null"], satellite, prior)


def _momentum_noise(scenario: Scenario, satellite: Satellite) -> np.ndarray:
    """N m s (n,), what motor noise may add to a wheel's momentum: in the loop a sample keeps 1 - k dt of it."""
    kept = 1.0 - scenario.tracking_bandwidth * scenario.sample_period
    impulse = scenario.torque_noise * scenario.sample_period * satellite.wheels.max_torque
    return _NOISE_MARGIN * impulse / np.sqrt(1.0 - kept**2)


def _write_null_motion(row: np.void, satellite: Satellite, prior: np.ndarray) -> None:
    wheels = satellite.wheels
    low, high = wheels.avoided_speed
    row["on"] = wheels.count > 3 and high > low
    if row["on"]:
        row["direction"] = wheels.null_direction
        row["avoided"] = wheels.inertia[:, None] * wheels.avoided_speed
        row["swing"] = np.abs(np.linalg.pinv(wheels.axes) @ prior).sum(axis=1) * satellite.rate_limit
        row["reserve"] = _RESERVE * row["swing"].max()
        row["most"] = (wheels.inertia * wheels.max_speed).max()


def _acceleration_noise(satellite: Satellite, scenario: Scenario) -> np.ndarray:
    """Std (n,) of a sample's dh/dt of each wheel over its torque limit: of the motors, and of two readings."""
    wheels, pulses, dt = satellite.wheels, satellite.sensors.encoder_pulses, scenario.sample_period
    change = np.sqrt(2.0) * satellite.tachometer_noise_std  # of two readings
    if pulses is not None:  # of three angles a, b, c it is (a - 2 b + c) / dt
        change = np.sqrt(6.0) * counting_std(2.0 * np.pi / pulses) / dt
    return np.hypot(scenario.torque_noise, wheels.inertia * change / (dt * wheels.max_torque))


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
