"""How an episode is drawn: the true inertia and its law, the disturbance, the initial state."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import (
    axpy_symmetric,
    is_physical,
    load_symmetric,
    multiply,
    store_symmetric,
)
from satid_gym.core.dynamics import set_momenta, set_speeds, to_body
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import between, normal, uniform
from satid_gym.core.records import PERIODIC, STATIC, STEP, TABLE

_MOST_DRAWS = 1000


@inline
def _draw_inertia(draw, nominal, stream):
    """J = R S J_nominal S R^T with S lognormal by axis and R a small rotation (symmetric)."""
    s0 = np.exp(0.5 * draw.inertia_std * normal(stream))
    s1 = np.exp(0.5 * draw.inertia_std * normal(stream))
    s2 = np.exp(0.5 * draw.inertia_std * normal(stream))
    a = nominal
    a = (a[0] * s0 * s0, a[1] * s1 * s1, a[2] * s2 * s2, a[3] * s0 * s1, a[4] * s0 * s2, a[5] * s1 * s2)
    if draw.tilt_std == 0.0:
        return a
    half = 0.5 * draw.tilt_std
    x, y, z = half * normal(stream), half * normal(stream), half * normal(stream)
    k = 1.0 / np.sqrt(1.0 + x * x + y * y + z * z)
    q = (k * x, k * y, k * z, k)
    ex, ey, ez = to_body(q, (1.0, 0.0, 0.0)), to_body(q, (0.0, 1.0, 0.0)), to_body(q, (0.0, 0.0, 1.0))
    fx, fy, fz = multiply(a, ex), multiply(a, ey), multiply(a, ez)
    return _dot(ex, fx), _dot(ey, fy), _dot(ez, fz), _dot(ex, fy), _dot(ex, fz), _dot(ey, fz)


@inline
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def _draw_law(draw, plant):
    """Write the inertia law's parameters and return its relative size; a table stays, and the draws are the same."""
    stream = plant.stream
    u, law, reached = uniform(stream), PERIODIC, draw.law_probability[STATIC]
    for candidate in range(STATIC, PERIODIC):
        if u < reached:
            law = candidate
            break
        reached += draw.law_probability[candidate + 1]
    if plant.law != TABLE:
        plant.law = law
    size = between(stream, draw.law_size[law, 0], draw.law_size[law, 1])
    plant.law_time = between(stream, draw.law_time[law, 0], draw.law_time[law, 1])
    plant.law_frequency = between(stream, draw.law_frequency[0], draw.law_frequency[1])
    plant.law_phase = between(stream, draw.law_phase[0], draw.law_phase[1])
    if plant.law == STEP and plant.law_time <= 0.0:
        plant.stepped = 1
    return size


@outline
def _fits_table(draw, plant, inertia):
    """Write the table's changes of an inertia where they are relative to it; whether all its knots are physical.

    The physical tensors are a convex cone, so what lies between two knots is physical as well.
    """
    for k in range(plant.knots):
        d = plant.knot_change[k]
        if draw.change_given == 0:
            for i in range(6):
                d[i] = draw.knot_size[k] * inertia[i]
        if not is_physical(axpy_symmetric(1.0, (d[0], d[1], d[2], d[3], d[4], d[5]), inertia)):
            return False
    return True


@inline
def _draw_body(draw, plant):
    """Write inertia and its change, both physical all along the law; False where 1000 draws gave none."""
    size = _draw_law(draw, plant)
    nominal, change = load_symmetric(plant.inertia), load_symmetric(plant.change)
    low = -1.0 if plant.law == PERIODIC else 0.0
    for _ in range(_MOST_DRAWS):
        inertia = _draw_inertia(draw, nominal, plant.stream)
        if draw.change_given == 0:
            change = axpy_symmetric(size, inertia, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        ends = is_physical(axpy_symmetric(low, change, inertia)) and is_physical(axpy_symmetric(1.0, change, inertia))
        if plant.law == STATIC:
            ends = True
        if plant.law == TABLE:
            ends = _fits_table(draw, plant, inertia)
        if ends and is_physical(inertia):
            store_symmetric(plant.inertia, inertia)
            store_symmetric(plant.change, change)
            return True
    return False


@inline
def _happens(probability, stream):
    """Whether a fault happens in the episode; one that cannot draws nothing."""
    return probability > 0.0 and uniform(stream) < probability


@inline
def _draw_faults(draw, plant):
    """Write what goes wrong in the episode, and when; what does not has no end, no wheel or no delay."""
    stream, n = plant.stream, plant.locked.shape[0]
    first, last = draw.fault_time[0], draw.fault_time[1]
    plant.faulty = 1
    plant.stuck_wheel = plant.weak_wheel = -1
    if _happens(draw.dropout_probability, stream):
        plant.dropout[0] = between(stream, first, last)
        plant.dropout[1] = plant.dropout[0] + between(stream, draw.dropout_duration[0], draw.dropout_duration[1])
        plant.dropout_silent = 1 if _happens(draw.dropout_silent, stream) else 0
    if _happens(draw.stuck_probability, stream):
        plant.stuck_wheel = np.int64(n * uniform(stream))
        plant.stuck[0] = between(stream, first, last)
        plant.stuck[1] = plant.stuck[0] + between(stream, draw.stuck_duration[0], draw.stuck_duration[1])
    if _happens(draw.loss_probability, stream):
        plant.weak_wheel = np.int64(n * uniform(stream))
        plant.weak_start = between(stream, first, last)
        plant.torque_left = 1.0 - between(stream, draw.loss_size[0], draw.loss_size[1])
    if draw.torque_delay[1] > 0:
        plant.torque_delay = np.int64(between(stream, draw.torque_delay[0], draw.torque_delay[1] + 1))
    if draw.bias_std > 0.0:
        for i in range(3):
            plant.gyro_bias[i] += draw.bias_std * normal(stream)


@outline
def draw_plant(draw, plant):
    """Turn the nominal `plant` into a drawn one, by its own stream; False where no inertia is physical.

    The disturbance has half its variance constant and half periodic with the orbit.
    """
    stream = plant.stream
    if not _draw_body(draw, plant):
        return False
    std = draw.disturbance_std * np.sqrt(0.5)
    for i in range(3):
        plant.torque_constant[i] += std * normal(stream)
        plant.torque_cosine[i] += std * normal(stream)
        plant.torque_sine[i] += std * normal(stream)
        plant.rate[i] += draw.rate_std * normal(stream)
    for k in range(plant.locked.shape[0]):
        span = draw.wheel_speed_range * plant.wheel_speed_max[k]
        speed = plant.wheel_speed[k] + between(stream, -span, span)
        plant.wheel_speed[k] = min(max(speed, -plant.wheel_speed_max[k]), plant.wheel_speed_max[k])
    if draw.attitude_random != 0:
        norm = 0.0
        for i in range(4):
            plant.attitude[i] = normal(stream)
            norm += plant.attitude[i] ** 2
        for i in range(4):
            plant.attitude[i] /= np.sqrt(norm)
    set_momenta(plant)
    set_speeds(plant)
    if draw.faulty != 0:
        _draw_faults(draw, plant)
    return True
