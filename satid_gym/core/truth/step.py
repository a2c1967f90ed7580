"""Step of the true inertia, and what becomes of the momentum then.

A step of the paper's keeps M, so the rate steps as well. A payload that is released turns on as it turned: M loses the
D omega that leaves with it, and the rate stays.
"""

from __future__ import annotations

from satid_gym.core.algebra import add, load, load_symmetric, multiply, store
from satid_gym.core.jit import inline
from satid_gym.core.truth.dynamics import set_speeds
from satid_gym.core.truth.inertia_law import is_released, steps


@inline
def take_step(plant):
    """Let J step where the time of its step has come; whether it does."""
    if not steps(plant) or plant.stepped != 0 or plant.time < plant.law_time:
        return False
    if is_released(plant):
        set_speeds(plant)
        left = multiply(load_symmetric(plant.change), load(plant.rate))
        store(plant.momentum, add(load(plant.momentum), left))
    plant.stepped = 1
    return True
