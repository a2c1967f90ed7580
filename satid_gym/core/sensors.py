"""Sensors and motors: where truth becomes a reading, and the last place that sees truth before the filter."""

from __future__ import annotations

import numpy as np

from satid_gym.core import faults
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import normal


@outline
def read_sensors(plant):
    """Write gyro (3,) and tachometer (n,) readings at plant.time."""
    silent, stuck = faults.gyro_dropped(plant), faults.stuck_tachometer(plant)
    for i in range(3):
        reading = plant.rate[i] + plant.gyro_bias[i] + plant.gyro_noise_std * normal(plant.stream)
        if not silent:
            plant.gyro[i] = reading
    for k in range(plant.tachometer.shape[0]):
        reading = plant.wheel_speed[k] + plant.tachometer_noise_std * normal(plant.stream)
        if k != stuck:
            plant.tachometer[k] = reading
    if plant.faulty != 0:
        faults.spike_gyro(plant)


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
    weak = faults.weak_wheel(plant)
    for k in range(torque.shape[0]):
        noisy = torque[k] + plant.torque_noise_std[k] * normal(plant.stream)
        wanted = min(max(noisy, -plant.torque_max[k]), plant.torque_max[k])
        if k == weak:
            wanted *= plant.torque_left
        plant.motor_torque[k] += follow * (wanted - plant.motor_torque[k])
