"""Log of a sample in full."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import load, store, store_symmetric
from satid_gym.core.belief.kalman import theta_covariance
from satid_gym.core.jit import outline
from satid_gym.core.truth.disturbance import external_torque, orbit_phase
from satid_gym.core.truth.inertia_law import inertia_at
from satid_gym.core.truth.state import load_state


@outline
def log_sample(log, plant, belief):
    """Write the present sample in full to a record of `log_dtype`."""
    log.time = plant.time
    store(log.momentum, load(plant.momentum))
    store(log.rate, load(plant.rate))
    store(log.gyro, load(plant.gyro))
    for k in range(log.wheel_speed.shape[0]):
        log.wheel_speed[k] = plant.wheel_speed[k]
        log.tachometer[k] = plant.tachometer[k]
    for i in range(4):
        log.attitude[i] = plant.attitude[i]
        log.star_tracker[i] = plant.tracker.reading[i] if plant.tracker.fresh != 0 else np.nan
    inertia = inertia_at(plant, plant.time)
    store_symmetric(log.inertia, inertia)
    store(log.torque, external_torque(plant, orbit_phase(plant, plant.time), load_state(plant)[1], inertia))
    for a in range(log.theta.shape[0]):
        log.theta[a] = belief.mean[3 + a]
        for b in range(log.theta.shape[0]):
            log.covariance[a, b] = theta_covariance(belief, a, b)
