"""Sampling of the truth: readings of an integrating gyro, of encoders, and of sensors that are late.

A late sensor takes its value of an instant within the sample, where the integrator stops for it, and gives it out whole
sample periods later. An encoder counts the pulses of a sample period, a gyro with a quantum the angle that many quanta
make up; what is left over goes into the next count, so an angle that is summed up is never off by more than one count.
Before the episode the body turned evenly. All of it acts where `plant.sampling.on` is not 0.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import load, store
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import normal, uniform
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.sampling import DELAY_SIGMAS, LINE
from satid_gym.core.truth.integrator import advance


@functools.cache
def sampling_dtype(n: int, lines: int) -> np.dtype:
    """Sampling: what the data sheet says of gyro and tachometers, and values on their way; 0 lines where none are."""
    return np.dtype(
        [
            ("on", INT),  # 0: all readings are values of the instant
            ("period", FLOAT),  # s, of a sample
            ("gyro_integrates", INT),
            ("gyro_delay", FLOAT),  # sample periods
            ("gyro_quantum", FLOAT),  # rad; 0: none
            ("gyro_range", FLOAT),  # rad/s; 0: no limit
            ("pulse", FLOAT),  # rad, of an encoder; 0: none
            ("tachometer_delay", FLOAT),
            ("turned", FLOAT, 3),  # integral of omega since the gyro's last value
            ("wheel_turned", FLOAT, n),
            ("gyro_line", FLOAT, (lines, 3)),  # values, the latest first: mean or instantaneous rate
            ("wheel_line", FLOAT, (lines, n)),
            ("gyro_left", FLOAT, 3),  # angle not yet counted, rad
            ("wheel_left", FLOAT, n),
        ],
        align=True,
    )


@inline
def draw_delay(std, plant):
    """Write the tachometers' delay; a tolerance of 0 draws nothing."""
    if std > 0.0:
        off = min(max(normal(plant.stream), -DELAY_SIGMAS), DELAY_SIGMAS)
        plant.sampling.tachometer_delay = max(plant.sampling.tachometer_delay + std * off, 0.0)


@outline
def begin_sampling(plant):
    """Fill the lines with the rates of the start, and draw where between two counts the angles begin."""
    s = plant.sampling
    late, wheel_late = s.gyro_delay % 1.0 * s.period, s.tachometer_delay % 1.0 * s.period
    for i in range(3):
        s.turned[i] = plant.rate[i] * late
        for line in range(LINE):
            s.gyro_line[line, i] = plant.rate[i]
        if s.gyro_quantum > 0.0:
            s.gyro_left[i] = s.gyro_quantum * uniform(plant.stream)
    for k in range(plant.locked.shape[0]):
        s.wheel_turned[k] = plant.wheel_speed[k] * wheel_late
        for line in range(LINE):
            s.wheel_line[line, k] = plant.wheel_speed[k]
        if s.pulse > 0.0:
            s.wheel_left[k] = s.pulse * uniform(plant.stream)


@outline
def _take_gyro(plant):
    s = plant.sampling
    for line in range(LINE - 1, 0, -1):
        store(s.gyro_line[line], load(s.gyro_line[line - 1]))
    for i in range(3):
        s.gyro_line[0, i] = s.turned[i] / s.period if s.gyro_integrates != 0 else plant.rate[i]
        s.turned[i] = 0.0


@outline
def _take_wheels(plant):
    s = plant.sampling
    for k in range(plant.locked.shape[0]):
        for line in range(LINE - 1, 0, -1):
            s.wheel_line[line, k] = s.wheel_line[line - 1, k]
        s.wheel_line[0, k] = s.wheel_turned[k] / s.period if s.pulse > 0.0 else plant.wheel_speed[k]
        s.wheel_turned[k] = 0.0


@outline
def advance_sampled(plant, torque, end):
    """Move the plant on by one sample, to time `end`, at constant motor torque (n,); take the sensors' values."""
    s = plant.sampling
    gyro, wheels = end - s.gyro_delay % 1.0 * s.period, end - s.tachometer_delay % 1.0 * s.period
    for stop in (min(gyro, wheels), max(gyro, wheels), end):
        if stop > plant.time:
            advance(plant, torque, stop - plant.time)
            plant.time = stop
        if stop == gyro:
            _take_gyro(plant)
            gyro = -1.0
        if stop == wheels:
            _take_wheels(plant)
            wheels = -1.0


@inline
def sampled_rate(plant):
    """Rate that the gyro's reading at plant.time stands for, rad/s."""
    s = plant.sampling
    return load(s.gyro_line[np.int64(s.gyro_delay)])


@inline
def sampled_speed(plant, k):
    """Speed of wheel k, rad/s, that the tachometer's reading at plant.time stands for; mean of a period if counted."""
    s = plant.sampling
    return s.wheel_line[np.int64(s.tachometer_delay), k]


@inline
def count_pulses(plant, k):
    """Speed of wheel k, rad/s, that its encoder's pulses of one period make up."""
    s = plant.sampling
    angle = sampled_speed(plant, k) * s.period + s.wheel_left[k]
    counted = np.floor(angle / s.pulse) * s.pulse
    s.wheel_left[k] = angle - counted
    return counted / s.period


@inline
def count_quanta(plant, i, reading):
    """Reading, rad/s, about axis i that whole quanta of angle make up."""
    s = plant.sampling
    angle = reading * s.period + s.gyro_left[i]
    counted = np.floor(angle / s.gyro_quantum) * s.gyro_quantum
    s.gyro_left[i] = angle - counted
    return counted / s.period


@inline
def limit_gyro(plant):
    """Hold the gyro's reading within its range, and flag one that is beyond."""
    high = plant.sampling.gyro_range
    if plant.faulty == 0:
        plant.gyro_flagged = 0
    for i in range(3):
        if abs(plant.gyro[i]) >= high:
            plant.gyro[i] = min(max(plant.gyro[i], -high), high)
            plant.gyro_flagged = 1
