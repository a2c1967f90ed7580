"""The core's belief record, built from a briefing and an estimator's tuning."""

from __future__ import annotations

import numpy as np

from satid_gym.core.records import MOMENTUM, RATE, belief_dtype, work_dtype
from satid_gym.estimators.settings import (
    PARAMETER_COUNT,
    AdaptiveEKFSettings,
    Briefing,
    EstimatorSettings,
    MomentumEKFSettings,
    Parameters,
    RateEKFSettings,
    disturbance_walk,
    estimated_parameters,
    gate_distance,
    inertia_parameters,
)


def state_size(settings: EstimatorSettings, parameters: Parameters, wheels: int) -> int:
    """Length of the filter's state."""
    return 3 + PARAMETER_COUNT[parameters] + (wheels if isinstance(settings, RateEKFSettings) else 3)


def new_belief(briefing: Briefing, settings: EstimatorSettings) -> np.ndarray:
    """One row of belief, not yet started by a reading."""
    if isinstance(settings, AdaptiveEKFSettings):
        rows = new_belief(briefing, settings.momentum())
        rows["adaptive"], rows["first_walk"] = 1, settings.inertia_walk
        rows["least_walk"], rows["most_walk"] = settings.least_walk, settings.most_walk
        rows["walk_drift"] = settings.walk_drift
        return rows
    wheels = briefing.wheels
    parameters = estimated_parameters(settings.parameters, briefing)
    n, p = wheels.count, PARAMETER_COUNT[parameters]
    rows = np.zeros(1, belief_dtype(n, p, state_size(settings, parameters, n)))
    row = rows[0]
    row["axes"], row["wheel_inertia"] = wheels.axes, wheels.inertia
    row["prior_theta"] = inertia_parameters(briefing.inertia, parameters)
    scale = row["theta_scale"] = briefing.theta_scale(parameters)
    row["substeps"] = 1
    if isinstance(settings, MomentumEKFSettings):
        row["kind"] = MOMENTUM
        row["gyro_std"] = briefing.gyro_noise_std
        row["gyro_noisy"] = briefing.gyro_is_noisy
        row["tachometer_std"] = briefing.tachometer_noise_std
        spin_std = wheels.inertia * briefing.tachometer_noise_std
        row["wheel_momentum_covariance"] = (wheels.axes * spin_std**2) @ wheels.axes.T
        row["prior_theta_std"] = briefing.prior_theta_std(parameters)
        row["prior_torque_std"] = briefing.disturbance_std
        row["walk"][3 : 3 + p] = settings.inertia_walk * scale
        row["walk"][3 + p :] = disturbance_walk(settings, briefing)
        row["substeps"] = settings.substeps
        row["gate"], row["torque_max"] = gate_distance(settings), wheels.max_torque
    else:
        row["kind"] = RATE
        row["gyro_std"], row["tachometer_std"] = settings.gyro_std, settings.wheel_speed_std
        row["prior_theta_std"] = settings.prior_inertia_std
        row["prior_std"] = settings.prior_rate_std, settings.prior_wheel_speed_std
        row["walk"][:3] = settings.rate_walk
        row["walk"][3 : 3 + p] = settings.inertia_walk
        row["walk"][3 + p :] = settings.wheel_speed_walk
    return rows


def new_work(beliefs: np.ndarray) -> np.ndarray:
    """Scratch space for one thread that works on such beliefs."""
    n, p, size = (beliefs[name].shape[1] for name in ("wheel_inertia", "prior_theta", "mean"))
    return np.zeros(1, work_dtype(n, p, size))
