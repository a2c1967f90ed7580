"""Scenario of the paper, and the prior of its filters."""

from __future__ import annotations

import math

from satid_gym.estimators import FilterPrior, MomentumEKFSettings
from satid_gym.evaluation import benchmark_scenario
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import Scenario, prior_of

MOTOR_NOISE = 0.05  # of the torque limit, at the motors' output
SOLAR_ARM = 0.01  # m, centre of pressure from centre of mass

MOMENTUM_SETTINGS = MomentumEKFSettings(substeps=2)
"""The default tuning: inertia walk 0.4 % per sqrt(s). Two midpoint steps a sample, for rates up to 0.4 rad/s."""


def scenario(horizon: float = 300.0) -> Scenario:
    """Scenario "paper", with the torque noise at the motors' output.

    The paper adds the noise after the motors' lag, the environment before it. There the lag reduces its standard
    deviation to the factor sqrt(f / (2 - f)), f = dt / (lag + dt), which the setting compensates.
    """
    world = benchmark_scenario("paper")
    follow = world.sample_period / (world.torque_lag + world.sample_period)
    return world.replace(horizon=horizon, torque_noise=MOTOR_NOISE / math.sqrt(follow / (2.0 - follow)))


def prior(satellite: str, horizon: float = 300.0) -> FilterPrior:
    """Prior of a satellite: the paper's wrong first guess of the inertia, and data sheets.

    The gyro noise includes the bias walk up to the end of the horizon; the disturbance is the solar pressure times its
    lever arm.
    """
    world = scenario(horizon)
    known = prior_of(SATELLITES[satellite], world)
    noise = math.hypot(known.gyro_noise_std, world.gyro_bias_walk * math.sqrt(horizon))
    return known.replace(gyro_noise_std=noise, disturbance_std=world.solar_pressure * SOLAR_ARM)
