"""Catalogue of the scenarios that have a name."""

from __future__ import annotations

import numpy as np

from satid_gym.appendages import Panels, Tank
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.rate import RateEKFSettings
from satid_gym.faults import Faults
from satid_gym.law_ranges import PAPER_LAWS
from satid_gym.operations import Operations
from satid_gym.scenario import Scenario
from satid_gym.sensors import Sensors
from satid_gym.star_tracker import StarTracker
from satid_gym.tolerances import Tolerances
from satid_gym.wheel_pyramid import WheelPyramid

_DEGREE = float(np.pi / 180.0)  # rad
_ARCSEC = _DEGREE / 3600.0
_UNCALIBRATED = Tolerances(
    gyro_bias=1e-4, gyro_scale=3e-3, gyro_alignment=1e-3, wheel_inertia=2e-3, wheel_alignment=1e-3
)

SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        Scenario(),
        Scenario(name="tight", wheel_speed_scale=0.1),
        Scenario(
            name="paper",
            sample_period=1.0,
            inertia_std=0.0,
            prior_scale={"cubesat": 0.80, "*": 0.85},
            laws=PAPER_LAWS,
            wheel_speed_range=0.0,
            initial_rate_std=0.0,
            torque_lag=0.1,
            gyro_noise_std=1e-6,
            tachometer_noise_std=0.0,
            disturbance_scale=0.0,
            gravity_gradient=False,
            random_attitude=False,
            rate_limit=0.5,
            estimator=RateEKFSettings(),
        ),
        Scenario(
            name="faults",
            gyro_bias_walk=1e-6,
            estimator=MomentumEKFSettings(adaptive=True, gate=1e-6),
            faults=Faults(
                gyro_dropout=0.5,
                gyro_dropout_silent=0.5,
                gyro_outlier=0.005,
                gyro_bias_std=2e-5,
                tachometer_stuck=0.5,
                wheel_loss=0.3,
                torque_delay=(0, 3),
            ),
        ),
        Scenario(
            name="flex",
            appendages=Panels(
                share=(0.02, 0.25), frequency=(0.1, 1.0), damping=(0.001, 0.01), deflection_limit=float(np.radians(0.5))
            ),
        ),
        Scenario(
            name="slosh",
            appendages=Tank(
                share=(0.01, 0.04), frequency=(0.02, 0.1), damping=(0.02, 0.1), deflection_limit=0.02, arm=(0.25, 0.5)
            ),
        ),
        Scenario(
            name="calibration",
            horizon=600.0,
            wheel_speed_range=0.02,
            tolerances=_UNCALIBRATED,
            sensors=Sensors(
                star_tracker=StarTracker(
                    boresight=np.array([0.6, 0.0, 0.8]),
                    across_std=2.0 * _ARCSEC,
                    round_std=20.0 * _ARCSEC,
                    rate_limit=0.5 * _DEGREE,
                    sun_exclusion=30.0 * _DEGREE,
                    earth_exclusion=10.0 * _DEGREE,
                )
            ),
        ),
        Scenario(
            name="operations",
            horizon=600.0,
            torque_noise=0.01,
            tachometer_noise_std=0.01,
            wheel_speed_range=0.4,
            tolerances=_UNCALIBRATED,
            sensors=Sensors(
                star_tracker=StarTracker(
                    boresight=np.array([1.0, 0.0, 0.0]),
                    across_std=2.0 * _ARCSEC,
                    round_std=20.0 * _ARCSEC,
                    rate_limit=0.5 * _DEGREE,
                )
            ),
            operations=Operations(),
        ),
        Scenario(name="wheels4", wheel_speed_range=0.5, wheels=WheelPyramid()),
    )
}
