"""Faults of sensors and actuators; they act where `plant.faulty` is not 0."""

from __future__ import annotations

from satid_gym.core.jit import inline
from satid_gym.core.random import between, uniform
from satid_gym.core.records import Fault

_DROPOUT, _OUTLIER, _STUCK = int(Fault.GYRO_DROPOUT), int(Fault.GYRO_OUTLIER), int(Fault.TACHOMETER_STUCK)
_LOSS, _DELAY = int(Fault.WHEEL_LOSS), int(Fault.TORQUE_DELAY)


@inline
def gyro_dropped(plant):
    """Whether the gyro delivers no new reading at plant.time; never before its first."""
    return plant.faulty != 0 and plant.gyro_dropout[0] < plant.time <= plant.gyro_dropout[1]


@inline
def stuck_tachometer(plant):
    """Wheel whose tachometer repeats itself at plant.time, or -1."""
    if plant.faulty != 0 and plant.tachometer_stuck[0] < plant.time <= plant.tachometer_stuck[1]:
        return plant.tachometer_stuck_wheel
    return -1


@inline
def weak_wheel(plant):
    """Wheel that gives a part of its torque only from plant.time on, or -1."""
    if plant.faulty != 0 and plant.time >= plant.wheel_loss_start:
        return plant.wheel_loss_wheel
    return -1


@inline
def spike_gyro(plant):
    """Flag a dropout that does not hide, and add an outlier to one axis of a reading that is new, now and then."""
    dropped = gyro_dropped(plant)
    plant.gyro_flagged = 1 if dropped and plant.gyro_dropout_silent == 0 else 0
    plant.spiked = 0
    if plant.gyro_outlier > 0.0 and not dropped and uniform(plant.stream) < plant.gyro_outlier:
        size = between(plant.stream, plant.gyro_outlier_size[0], plant.gyro_outlier_size[1])
        which = 6.0 * uniform(plant.stream)
        axis = int(which) % 3
        plant.gyro[axis] += size if which < 3.0 else -size
        plant.spiked = 1


@inline
def delay_command(plant, torque):
    """Write what the motors are to follow: `torque` (n,) as it was commanded torque_delay samples ago."""
    waiting, last = plant.torque_waiting, plant.torque_delay
    for k in range(torque.shape[0]):
        waiting[last, k] = torque[k]
        plant.torque_obeyed[k] = waiting[0, k]
        for place in range(last):
            waiting[place, k] = waiting[place + 1, k]


@inline
def note_motors(plant, report):
    """Write to the report which faults act on the motors in the sample that begins at plant.time."""
    if weak_wheel(plant) >= 0:
        report.faults[_LOSS] = 1
    if plant.torque_delay > 0:
        report.faults[_DELAY] = 1


@inline
def note_sensors(plant, report):
    """Write to the report which faults acted on the readings at plant.time."""
    if gyro_dropped(plant):
        report.faults[_DROPOUT] = 1
    if plant.spiked != 0:
        report.faults[_OUTLIER] = 1
    if stuck_tachometer(plant) >= 0:
        report.faults[_STUCK] = 1
