"""Kernels of a decision with an external truth: those of an episode without the integrator.

They work on row 0. The plant's record holds the truth's last state.
"""

from __future__ import annotations

from satid_gym.core import episode
from satid_gym.core.algebra import add, axpy, load, multiply, store
from satid_gym.core.jit import inline, kernel
from satid_gym.core.rotation import load_quaternion, product, store_quaternion, turn
from satid_gym.core.sample import drive as drive_plant
from satid_gym.core.sample import measure as measure_plant
from satid_gym.core.sample import sample_end
from satid_gym.core.truth.disturbance import external_torque, orbit_phase
from satid_gym.core.truth.inertia_law import inertia_at
from satid_gym.core.truth.sensors import read_sensors
from satid_gym.core.wheels import wheel_momentum


@kernel
def draw(rows, templates):
    """Draw an episode; False where no inertia drawn is physical."""
    return episode.draw(rows, 0, templates)


@kernel
def start(rows, work):
    """Let the filter take the first readings."""
    episode.start(rows, 0, work[0])


@kernel
def drive(rows, work, disturbance):
    """Motor torque until the next sample, to the plant; to `disturbance` (3,) the torque from outside, in its middle.

    The body is taken to turn on as it does until then.
    """
    plant, task = rows.plants[0], rows.tasks[0]
    drive_plant(plant, task, work[0], rows.reports[0])
    half = 0.5 * task.sample_period
    middle, turned = plant.time + half, turn(axpy(half, load(plant.rate), (0.0, 0.0, 0.0)))
    q = product(load_quaternion(plant.attitude), turned)
    store(disturbance, external_torque(plant, orbit_phase(plant, middle), q, inertia_at(plant, middle)))


@kernel
def turn_on(plants, before, dt):
    """Attitude after a sample in which the rate went from `before` (3,) to the plant's."""
    plant = plants[0]
    angle = axpy(0.5 * dt, add(load(before), load(plant.rate)), (0.0, 0.0, 0.0))
    store_quaternion(plant.attitude, product(load_quaternion(plant.attitude), turn(angle)))


@inline
def note_momentum(plant):
    """Total momentum, for pictures; what oscillators add to it is left out."""
    spin = wheel_momentum(plant, plant.wheel_speed)
    store(plant.momentum, add(multiply(inertia_at(plant, plant.time), load(plant.rate)), spin))


@kernel
def read(plants):
    """First readings."""
    note_momentum(plants[0])
    read_sensors(plants[0])


@kernel
def measure(rows):
    """Time and readings at the end of a sample, and what the truth did in it."""
    plant, task = rows.plants[0], rows.tasks[0]
    plant.time = sample_end(plant, task.sample_period)
    note_momentum(plant)
    measure_plant(plant, task, rows.reports[0])


@kernel
def believe(rows, work):
    """Give the filter the readings."""
    episode.believe(rows.plants[0], rows.beliefs[0], rows.tasks[0], work[0], rows.reports[0])
