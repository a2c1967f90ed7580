"""Sensors and motors: where truth becomes a reading, and the last place that sees truth before the filter."""

from __future__ import annotations

import numpy as np

from satid_gym.core.jit import inline
from satid_gym.core.random import normal


@inline
def read_sensors(plant):
    """Write gyro (3,) and tachometer (n,) readings at plant.time."""
    for i in range(3):
        plant.gyro[i] = plant.rate[i] + plant.gyro_bias[i] + plant.gyro_noise_std * normal(plant.stream)
    for k in range(plant.tachometer.shape[0]):
        plant.tachometer[k] = plant.wheel_speed[k] + plant.tachometer_noise_std * normal(plant.stream)


@inline
def walk_gyro_bias(plant, dt):
    """Random walk of the gyro bias over dt seconds."""
    std = plant.gyro_bias_walk * np.sqrt(dt)
    for i in range(3):
        plant.gyro_bias[i] += std * normal(plant.stream)


@inline
def drive_motors(plant, torque, dt):
    """Motor torque of one sample period: `torque` (n,) with noise, held within the limit, behind a first-order lag.

    The discrete factor dt / (lag + dt) is the paper's; without lag the motor follows at once.
    """
    follow = dt / (plant.torque_lag + dt)
    for k in range(torque.shape[0]):
        noisy = torque[k] + plant.torque_noise_std[k] * normal(plant.stream)
        wanted = min(max(noisy, -plant.torque_max[k]), plant.torque_max[k])
        plant.motor_torque[k] += follow * (wanted - plant.motor_torque[k])
