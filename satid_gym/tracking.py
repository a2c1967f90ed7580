"""Settings of the rate loop in the core's record of the task, built from a problem."""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.prior import counting_std
from satid_gym.problem import Problem
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario

_SETTLED = 4.5  # samples without a larger change, after which the rate loop learns from what a motor does
_PROMPT = 0.5  # likewise, after which it tests whether a motor's gain has jumped
_GAIN_STD, _FRICTION_STD = 0.16, 0.05  # what it believes at first of gain, and of friction over the torque limit
_RESERVE = 0.1  # of the largest swing of a wheel, room that the null motion keeps
_NOISE_MIN = 0.01  # of the torque limit
_NOISE_MARGIN = 3.0  # standard deviations of its noise by which a wheel's momentum stays below its limit


def write_tracking(row: np.void, p: Problem, satellite: Satellite, prior: np.ndarray) -> None:
    """Write the settings of a satellite's rate loop; `prior` (3, 3) is the inertia that is believed, kg m^2."""
    wheels = satellite.wheels
    row["on"] = p.control == "rate"
    row["bandwidth"] = p.scenario.tracking_bandwidth
    row["slope"] = p.scenario.reference_slope * wheels.max_torque.min() / np.linalg.eigvalsh(satellite.inertia)[-1]
    row["allocation"], row["rotor_inertia"] = np.linalg.pinv(wheels.axes), wheels.rotor_inertia
    noise = _NOISE_MARGIN * p.scenario.tracking_noise * wheels.max_torque
    row["spin_max"] = np.maximum(wheels.max_momentum - noise, 0.0)
    late, sensors = 2.0 * p.scenario.command_lateness, satellite.sensors
    row["motors"]["settled"] = _SETTLED * p.scenario.sample_period + late
    row["motors"]["prompt"] = (_PROMPT + sensors.counts + sensors.tachometer_delay) * p.scenario.sample_period + late
    noise = np.maximum(_acceleration_noise(satellite, p.scenario), _NOISE_MIN)
    row["motors"]["noise"], row["motors"]["expected"] = noise, 1.0
    row["motors"]["prior"] = (noise[:, None] / [_GAIN_STD, _FRICTION_STD]) ** 2
    write_null_motion(row["null"], satellite, prior)


def write_null_motion(row: np.void, satellite: Satellite, prior: np.ndarray) -> None:
    """Write the settings of a satellite's null motion, a record of `core.control.null_motion.null_dtype`."""
    wheels = satellite.wheels
    row["on"] = wheels.have_null_motion
    if row["on"]:
        row["direction"] = wheels.null_direction
        row["avoided"] = wheels.inertia[:, None] * wheels.avoided_speed
        row["swing"] = np.abs(np.linalg.pinv(wheels.axes) @ prior).sum(axis=1) * satellite.rate_limit
        row["reserve"] = _RESERVE * row["swing"].max()
        row["most"] = wheels.max_momentum.max()


def _acceleration_noise(satellite: Satellite, scenario: Scenario) -> np.ndarray:
    """Std (n,) of a sample's dh/dt of each wheel over its torque limit: of the motors, and of two readings."""
    wheels, pulses, dt = satellite.wheels, satellite.sensors.encoder_pulses, scenario.sample_period
    change = np.sqrt(2.0) * satellite.tachometer_noise_std  # of two readings
    if pulses is not None:  # of three angles a, b, c it is (a - 2 b + c) / dt
        change = np.sqrt(6.0) * counting_std(2.0 * np.pi / pulses) / dt
    return np.hypot(scenario.torque_noise, wheels.inertia * change / (dt * wheels.max_torque))
