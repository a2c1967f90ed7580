"""Random walks of the truth: the gyro's bias and, in studies of the filter's model, inertia and disturbance torque."""

from __future__ import annotations

import numpy as np

from satid_gym.core.jit import inline
from satid_gym.core.random import normal
from satid_gym.core.truth.dynamics import set_speeds


@inline
def walk_gyro_bias(plant, dt):
    """Random walk of the gyro bias over dt seconds."""
    std = plant.gyro_bias_walk * np.sqrt(dt)
    for i in range(3):
        plant.gyro_bias[i] += std * normal(plant.stream)


@inline
def walk_as_modelled(plant, dt):
    """Random walk of the moments of inertia and of the disturbance torque, which draws nothing where both are 0.

    The momenta stay, so the rate follows the inertia.
    """
    if plant.torque_walk > 0.0:
        for i in range(3):
            plant.torque_constant[i] += plant.torque_walk * np.sqrt(dt) * normal(plant.stream)
    if plant.inertia_walk[0] > 0.0:
        for i in range(3):
            plant.inertia[i, i] += plant.inertia_walk[i] * np.sqrt(dt) * normal(plant.stream)
        set_speeds(plant)
