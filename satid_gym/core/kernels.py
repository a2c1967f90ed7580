"""Kernels that Python calls, other than `episode.step_many`.

Those that take `rows` or `beliefs` work on row 0.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core import episode, report, reward
from satid_gym.core.algebra import store_symmetric
from satid_gym.core.belief import filters
from satid_gym.core.jit import kernel
from satid_gym.core.observation import observe
from satid_gym.core.truth.dynamics import set_momenta, set_speeds, spin_momentum
from satid_gym.core.truth.inertia_law import inertia_at
from satid_gym.core.truth.integrator import integrate


@kernel
def simulate(plants, torque, dt, substeps, path, applied):
    """Fly `torque` (N, n), each held dt seconds, from the rate and wheel speed in the plant.

    N + 1 states go to `path`, a tuple (momentum, rate, wheel speed, attitude, inertia, deflection) of arrays; the mean
    motor torque of each interval to `applied` (N, n).
    """
    plant = plants[0]
    momentum, rate, wheel_speed, attitude, inertia, deflection = path
    set_momenta(plant)
    set_speeds(plant)
    for i in range(torque.shape[0] + 1):
        momentum[i] = plant.momentum
        rate[i] = plant.rate
        wheel_speed[i] = plant.wheel_speed
        attitude[i] = plant.attitude
        deflection[i] = plant.oscillators.deflection
        store_symmetric(inertia[i], inertia_at(plant, plant.time))
        if i == torque.shape[0]:
            break
        for k in range(torque.shape[1]):
            limit = plant.torque_max[k]
            plant.motor_torque[k] = min(max(torque[i, k], -limit), limit)
            applied[i, k] = -spin_momentum(plant, k)
        start = plant.time
        for s in range(substeps):
            # the end of each substep is computed from the start, so that no rounding piles up
            integrate(plant, plant.motor_torque, start + (s + 1) * dt / substeps - plant.time)
        for k in range(torque.shape[1]):
            mean = (applied[i, k] + spin_momentum(plant, k)) / dt
            limit = plant.torque_max[k] if plant.rubs == 0 else np.inf
            applied[i, k] = min(max(mean, -limit), limit)  # what exceeds it is rounding


@kernel
def law_inertia(plants, times, out):
    """True inertia at times (N,), which must not decrease, to out (N, 3, 3)."""
    plant = plants[0]
    for i in range(times.shape[0]):
        plant.stepped = 1 if times[i] >= plant.law_time else 0
        store_symmetric(out[i], inertia_at(plant, times[i]))


@kernel
def start_filter(beliefs, work, gyro, tachometer):
    """Belief after the first reading."""
    filters.start(beliefs[0], work[0], gyro, tachometer)


@kernel
def predict_filter(beliefs, work, tachometer, dt):
    """Move the belief on by dt seconds to the reading `tachometer` (n,)."""
    filters.predict(beliefs[0], work[0], tachometer, dt)


@kernel
def condition_filter(beliefs, work, gyro, tachometer):
    """Update the belief with a reading; normalised innovation squared per degree of freedom."""
    return filters.condition(beliefs[0], work[0], gyro, tachometer)


@kernel
def condition_filter_wheels(beliefs, work, tachometer):
    """Update the belief with the tachometers alone; normalised innovation squared per degree of freedom."""
    return filters.condition_wheels(beliefs[0], work[0], tachometer)


@kernel
def condition_filter_attitude(beliefs, work, attitude):
    """Update the belief with a star tracker's reading (4,); normalised innovation squared per degree of freedom."""
    return filters.condition_attitude(beliefs[0], work[0], attitude)


@kernel
def run_filter(beliefs, work, gyro, tachometer, dt, mean, covariance, nis):
    """Filter readings gyro (N, 3) and tachometer (N, n), the first of which starts the belief."""
    belief, scratch = beliefs[0], work[0]
    filters.start(belief, scratch, gyro[0], tachometer[0])
    mean[0], covariance[0], nis[0] = belief.mean, belief.covariance, 0.0
    for i in range(1, gyro.shape[0]):
        filters.predict(belief, scratch, tachometer[i], dt)
        nis[i] = filters.condition(belief, scratch, gyro[i], tachometer[i])
        mean[i], covariance[i] = belief.mean, belief.covariance


@kernel
def command(rows, work, action):
    """First part of a decision for an estimator that is not compiled."""
    episode.command(rows.plants[0], rows.tasks[0], work[0], rows.reports[0], action)


@kernel
def steer(rows, work):
    """Torque of the rate loop, where it is on, until the next readings."""
    episode.steer(rows.plants[0], rows.beliefs[0], rows.tasks[0], work[0], rows.reports[0])


@kernel
def sample(rows, work):
    """Truth and sensors of one sample period."""
    episode.sample(rows.plants[0], rows.tasks[0], work[0], rows.reports[0])


@kernel
def announce(rows, beliefs):
    """Tell a filter that is not the row's own of what `episode.announce` tells."""
    episode.announce(rows.plants[0], beliefs[0], rows.tasks[0])


@kernel
def note_update(rows):
    """Tally rate, deflection and NIS after a sample's update."""
    report.note_peaks(rows.plants[0], rows.beliefs[0], rows.reports[0])
    report.note_nis(rows.tasks[0], rows.reports[0].nis)


@kernel
def uncertainty_nats(beliefs, work, criterion):
    """Uncertainty of theta in nats."""
    return reward.uncertainty_nats(beliefs[0], work[0], criterion)


@kernel
def conclude(rows, work):
    """Last part of a decision."""
    plant, belief, task = rows.plants[0], rows.beliefs[0], rows.tasks[0]
    episode.conclude(plant, belief, task, work[0], rows.reports[0], rows.observations[0])


@kernel
def look(rows, work):
    """Assessment and observation of the present belief."""
    plant, belief = rows.plants[0], rows.beliefs[0]
    report.assess(plant, belief, work[0], rows.reports[0])
    observe(belief, rows.tasks[0], plant.gyro, plant.tachometer, rows.observations[0])
