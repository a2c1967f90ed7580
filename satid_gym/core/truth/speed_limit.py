"""Speed limits of the wheels: one that reaches its limit is locked to the body until its motor pulls it back."""

from __future__ import annotations

from satid_gym.core.algebra import add, axpy_symmetric, cross, inverse, load, multiply, subtract
from satid_gym.core.jit import inline, outline
from satid_gym.core.truth import oscillators
from satid_gym.core.truth.disturbance import external_torque, orbit_phase
from satid_gym.core.truth.dynamics import free_wheel_inertia, set_speeds, spin_momentum, sum_free
from satid_gym.core.truth.inertia_law import inertia_at, inertia_slope
from satid_gym.core.truth.state import load_state
from satid_gym.core.wheels import along_axis, sum_wheels

AT_LIMIT = 1e-11  # relative to the speed limit


@inline
def _at_limit(plant, k):
    return abs(plant.wheel_speed[k]) >= plant.wheel_speed_max[k] * (1.0 - AT_LIMIT)


@inline
def _lock(plant, k):
    side = 1.0 if plant.wheel_speed[k] > 0.0 else -1.0
    plant.locked[k] = 1
    plant.wheel_momentum[k] = plant.wheel_inertia[k] * side * plant.wheel_speed_max[k]


@outline
def hold_or_release(plant, torque, stay):
    """Lock the wheels at their limit that the motor pushes outward, release those it pulls back (none where `stay`)."""
    near = False
    for k in range(torque.shape[0]):
        near = near or _at_limit(plant, k)
    if not near:
        return
    t, omega = plant.time, load(plant.rate)
    m, q = load_state(plant)
    inertia = inertia_at(plant, t)
    tau = external_torque(plant, orbit_phase(plant, t), q, inertia)
    push = subtract(add(cross(m, omega), tau), sum_free(plant, torque))
    push = subtract(push, multiply(inertia_slope(plant, t), omega))
    rest = axpy_symmetric(-1.0, free_wheel_inertia(plant), inertia)
    if plant.oscillators.mass.shape[0] == 0:
        acceleration = multiply(inverse(rest), push)
    else:
        residual = subtract(m, sum_wheels(plant.axes, plant.wheel_momentum))
        acceleration = oscillators.accelerate(plant.oscillators, rest, residual, push)
    for k in range(torque.shape[0]):
        side = 1.0 if plant.wheel_speed[k] > 0.0 else -1.0
        holding = plant.wheel_inertia[k] * along_axis(plant.axes, k, acceleration)
        if _at_limit(plant, k) and (stay or side * (torque[k] - holding) >= 0.0):
            _lock(plant, k)
        elif plant.locked[k] == 1:
            plant.locked[k] = 0
            plant.wheel_momentum[k] = spin_momentum(plant, k)


@inline
def overspeed(plant, torque, h, omega):
    """How far beyond its limit the fastest free wheel is after h seconds, when the rate is omega, relative to it."""
    worst = -1.0
    for k in range(torque.shape[0]):
        if plant.locked[k] == 0:
            momentum = plant.wheel_momentum[k] + h * torque[k]
            speed = momentum / plant.wheel_inertia[k] - along_axis(plant.axes, k, omega)
            worst = max(worst, abs(speed) / plant.wheel_speed_max[k] - 1.0)
    return worst


@inline
def present_overspeed(plant):
    """How far beyond its limit the fastest free wheel is at plant.time, relative to the limit."""
    worst = -1.0
    for k in range(plant.locked.shape[0]):
        if plant.locked[k] == 0:
            worst = max(worst, abs(plant.wheel_speed[k]) / plant.wheel_speed_max[k] - 1.0)
    return worst


@inline
def limit_speeds(plant):
    """Lock wheels that a step of J has thrown beyond their limit; the body takes up the difference."""
    beyond = False
    for k in range(plant.locked.shape[0]):
        if plant.locked[k] == 0 and abs(plant.wheel_speed[k]) > plant.wheel_speed_max[k]:
            _lock(plant, k)
            beyond = True
    if beyond:
        set_speeds(plant)
