"""The paper's world, and what a filter may know of it before launch."""

from __future__ import annotations

import math

from satid_gym.estimators import Briefing, MomentumEKFSettings, brief
from satid_gym.evaluation import benchmark_scenario
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import Scenario

MOTOR_NOISE = 0.05  # of the torque limit, as the motors deliver it
SOLAR_ARM = 0.01  # m, centre of pressure from centre of mass

MOMENTUM_SETTINGS = MomentumEKFSettings(substeps=2)
"""The default tuning: inertia walk 0.4 % per sqrt(s). Two midpoint steps a sample, for rates up to 0.4 rad/s."""


def scenario(horizon: float = 300.0) -> Scenario:
    """Scenario "paper", with the torque noise at the motors' output.

    The paper adds the noise behind the motors' lag, the environment in front of it, where the lag would take
    sqrt(f / (2 - f)) of its standard deviation, f = dt / (lag + dt). The setting makes up for that.
    """
    world = benchmark_scenario("paper")
    follow = world.sample_period / (world.torque_lag + world.sample_period)
    return world.replace(horizon=horizon, torque_noise=MOTOR_NOISE / math.sqrt(follow / (2.0 - follow)))


def briefing(satellite: str, horizon: float = 300.0) -> Briefing:
    """What is known of a satellite: the paper's wrong first guess of the inertia, and data sheets.

    The gyro's noise has its bias walk added, as it is at the end of the horizon; the disturbance is the solar
    pressure on its arm.
    """
    world = scenario(horizon)
    known = brief(SATELLITES[satellite], world)
    noise = math.hypot(known.gyro_noise_std, world.gyro_bias_walk * math.sqrt(horizon))
    return known.replace(gyro_noise_std=noise, disturbance_std=world.solar_pressure * SOLAR_ARM)
