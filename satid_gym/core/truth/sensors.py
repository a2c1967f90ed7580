"""Sensors and motors: readings of gyro, tachometers and star tracker, and the torque that the motors really give."""

from __future__ import annotations

from satid_gym.core.algebra import dot, load
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import normal
from satid_gym.core.truth import faults, sampling
from satid_gym.core.truth.star_tracker import read_tracker


@outline
def read_sensors(plant):
    """Write the readings at plant.time: gyro (3,), tachometer (n,), and the star tracker's where there is one."""
    silent, stuck = faults.gyro_dropped(plant), faults.stuck_tachometer(plant)
    sampled = plant.sampling.on != 0
    rate = sampling.sampled_rate(plant) if sampled else load(plant.rate)
    if plant.gyro_uncalibrated != 0:
        G = plant.gyro_gain
        rate = dot(load(G[0]), rate), dot(load(G[1]), rate), dot(load(G[2]), rate)
    for i in range(3):
        reading = rate[i] + plant.gyro_bias[i] + plant.gyro_noise_std * normal(plant.stream)
        if plant.sampling.gyro_quantum > 0.0:
            reading = sampling.count_quanta(plant, i, reading)
        if not silent:
            plant.gyro[i] = reading
    for k in range(plant.tachometer.shape[0]):
        if plant.sampling.pulse > 0.0:
            reading = sampling.count_pulses(plant, k)
        else:
            speed = sampling.sampled_speed(plant, k) if sampled else plant.wheel_speed[k]
            reading = speed + plant.tachometer_noise_std * normal(plant.stream)
        if k != stuck:
            plant.tachometer[k] = reading
    if plant.faulty != 0:
        faults.spike_gyro(plant)
    if plant.sampling.gyro_range > 0.0:
        sampling.limit_gyro(plant)
    if plant.tracker.on != 0:
        read_tracker(plant)


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
            wanted *= plant.wheel_loss_left
        plant.motor_torque[k] += follow * (wanted - plant.motor_torque[k])
