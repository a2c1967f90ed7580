"""Increments: angles that the body and its wheels turn through, along the steps of the integrator.

    integral of omega       Simpson's rule over each step, its middle by a step of half the length
    integral of Omega       h = j (Omega + A^T omega) grows evenly: (h_0 + h_1) dt / (2 j) - A^T integral of omega

The rule is of the fourth order, as the integrator. A locked wheel turns at its limit.
"""

from __future__ import annotations

from satid_gym.core.algebra import add, axpy, load, store
from satid_gym.core.jit import outline
from satid_gym.core.wheels import along_axis


@outline
def add_increments(plant, torque, h, middle, last):
    """Add those of a step of h seconds that begins at plant.time, with omega `middle` and `last` on its way."""
    turned = plant.sampling.turned
    angle = axpy(h / 6.0, add(axpy(4.0, middle, load(plant.rate)), last), (0.0, 0.0, 0.0))
    store(turned, add(load(turned), angle))
    for k in range(plant.locked.shape[0]):
        momentum = plant.wheel_momentum[k]
        if plant.locked[k] == 0:
            spun = (momentum + 0.5 * h * torque[k]) * h / plant.wheel_inertia[k] - along_axis(plant.axes, k, angle)
        else:
            spun = momentum * h / plant.wheel_inertia[k]
        plant.sampling.wheel_turned[k] += spun
