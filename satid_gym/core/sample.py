"""Sample: motors, body and sensors of one sample period, and what the report tallies of them."""

from __future__ import annotations

import numpy as np

from satid_gym.core.jit import inline, outline
from satid_gym.core.truth import faults
from satid_gym.core.truth.integrator import advance
from satid_gym.core.truth.operations import note_operations
from satid_gym.core.truth.random_walk import walk_as_modelled, walk_gyro_bias
from satid_gym.core.truth.sampling import advance_sampled
from satid_gym.core.truth.sensors import drive_motors, read_sensors
from satid_gym.core.wheels import is_in_band


@inline
def drive(plant, task, work, report):
    """Write the torque that the motors give until the next sample, of what work.torque (n,) commands."""
    if plant.faulty != 0:
        faults.note_motors(plant, report)
        faults.delay_command(plant, work.torque)
        drive_motors(plant, plant.torque_obeyed, task.sample_period)
    else:
        drive_motors(plant, work.torque, task.sample_period)


@inline
def sample_end(plant, dt):
    """End of the sample period dt that begins at plant.time, so that rounding does not pile up."""
    return (np.round(plant.time / dt) + 1.0) * dt


@inline
def measure(plant, task, report):
    """Read the sensors at plant.time, and tally where the truth is beyond its limits."""
    walk_gyro_bias(plant, task.sample_period)
    read_sensors(plant)
    outside = False
    for i in range(3):
        outside = outside or abs(plant.rate[i]) > task.rate_limit
    if outside:
        report.outside += 1.0
    if is_in_band(plant.wheel_speed, plant.avoided_speed):
        report.in_avoided_band += 1.0
    if is_in_band(plant.tachometer, plant.avoided_speed):
        report.read_in_band += 1.0
    report.tracking += plant.tracker.tracks
    for k in range(plant.locked.shape[0]):
        report.saturated[k] = max(report.saturated[k], plant.locked[k])
    bent = 0.0
    for k in range(report.deflection.shape[0]):
        deflection = abs(plant.oscillators.deflection[k])
        report.deflection[k] = max(report.deflection[k], deflection)
        if deflection > task.deflection_limit[k]:
            bent = 1.0
    report.bent += bent
    if plant.operations.on != 0:
        note_operations(plant, report)
    if plant.faulty != 0:
        faults.note_sensors(plant, report)


@outline
def sample(plant, task, work, report):
    """Move the truth on by one sample period and read the sensors."""
    walk_as_modelled(plant, task.sample_period)
    drive(plant, task, work, report)
    end = sample_end(plant, task.sample_period)
    if plant.sampling.on != 0:
        advance_sampled(plant, plant.motor_torque, end)
    else:
        advance(plant, plant.motor_torque, end - plant.time)
    plant.time = end
    measure(plant, task, report)
