"""Expectations of a scenario: how a satellite is disturbed, shaken and turned between two readings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from satid_gym.satellite import Satellite

if TYPE_CHECKING:
    from satid_gym.scenario import Scenario


def agitation(satellite: Satellite, scenario: Scenario) -> float:
    """Std of the rate that the motors' noise gives the body in a sample, of the axis that it moves least, rad/s."""
    noise = satellite.wheels.axes * (scenario.torque_noise * satellite.wheels.max_torque)
    change = scenario.sample_period * np.linalg.norm(noise, axis=1) / np.diag(satellite.inertia)
    return float(change.min())


def nutation(satellite: Satellite, scenario: Scenario) -> float:
    """Angle by which body and momentum turn against each other in a sample, with the momentum of the start, rad."""
    wheels = satellite.wheels
    stored = wheels.momentum_reach * scenario.wheel_speed_range
    moments = np.linalg.eigvalsh(satellite.inertia)
    body = moments[-1] * scenario.initial_rate_std * satellite.rate_limit
    return float(np.hypot(np.linalg.norm(stored), body) * scenario.sample_period / moments[0])


def disturbance_walk(satellite: Satellite, scenario: Scenario) -> float:
    """Random walk that spreads as far as the known causes move the disturbance, N m per sqrt(s).

    The orbit-periodic torque has rms slope n std / sqrt(2), held over the horizon; the gravity gradient, of
    amplitude A = 3/2 n^2 (J_max - J_min), forgets itself within the time the body takes to turn by a radian at
    its rate limit omega: A sqrt(2 omega).
    """
    n = scenario.orbit_rate
    periodic = 0.5 * satellite.disturbance_std * n * np.sqrt(0.5 * scenario.horizon)
    moments = np.linalg.eigvalsh(satellite.inertia)
    gradient = 1.5 * n**2 * (moments[-1] - moments[0]) * np.sqrt(2.0 * satellite.rate_limit)
    return float(np.hypot(periodic, gradient if scenario.gravity_gradient else 0.0))
