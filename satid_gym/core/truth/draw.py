"""Draw of an episode: the true inertia and its law, the disturbance, the initial state, and what goes wrong."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import (
    axpy,
    axpy_symmetric,
    dot,
    load_symmetric,
    multiply,
    norm,
    store_symmetric,
)
from satid_gym.core.jit import inline, outline
from satid_gym.core.random import between, normal, uniform
from satid_gym.core.records import InertiaMode
from satid_gym.core.rotation import to_body
from satid_gym.core.truth.dynamics import set_momenta, set_speeds
from satid_gym.core.truth.inertia_law import steps
from satid_gym.core.truth.operations import begin_operations
from satid_gym.core.truth.oscillator_draw import draw_oscillators, draw_scale, fits
from satid_gym.core.truth.oscillator_geometry import point_inertia
from satid_gym.core.truth.sampling import begin_sampling, draw_delay
from satid_gym.core.truth.star_tracker import begin_tracker
from satid_gym.core.wheels import wheel_axis

_DRAWS_MAX = 1000
_STATIC, _PERIODIC, _TABLE = int(InertiaMode.STATIC), int(InertiaMode.PERIODIC), int(InertiaMode.TABLE)
_DEPLOYMENT = int(InertiaMode.DEPLOYMENT)


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
    return dot(ex, fx), dot(ey, fy), dot(ez, fz), dot(ex, fy), dot(ex, fz), dot(ey, fz)


@inline
def _within(stream, bounds):
    """Uniform on [bounds[0], bounds[1]]."""
    return between(stream, bounds[0], bounds[1])


@inline
def _draw_law(draw, plant):
    """Write the inertia law's parameters and return its relative size.

    A table or the law of a mass stays, and the draws are the same; a mass whose place is drawn then draws more.
    """
    stream = plant.stream
    u, law, reached = uniform(stream), _PERIODIC, draw.law_probability[_STATIC]
    for candidate in range(_STATIC, _PERIODIC):
        if u < reached:
            law = candidate
            break
        reached += draw.law_probability[candidate + 1]
    if plant.law < _TABLE:
        plant.law = law
    size = _within(stream, draw.law_size[law])
    plant.law_time = _within(stream, draw.law_time[law])
    plant.law_frequency = _within(stream, draw.law_frequency)
    plant.law_phase = _within(stream, draw.law_phase)
    if steps(plant) and plant.law_time <= 0.0:
        plant.stepped = 1
    if plant.law >= _DEPLOYMENT and draw.change_given == 0:
        plant.law_duration = _within(stream, draw.law_duration)
        size = _within(stream, draw.mass_size)
    return size


@inline
def _draw_mass(plant, size, inertia):
    """Change by a mass in a direction drawn on the sphere, m r^2 being `size` times the mean moment (symmetric)."""
    x, y, z = normal(plant.stream), normal(plant.stream), normal(plant.stream)
    mean = (inertia[0] + inertia[1] + inertia[2]) / 3.0
    k = (size if plant.law == _DEPLOYMENT else -size) * mean / (x * x + y * y + z * z)
    return point_inertia(k, (x, y, z))


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
        if not fits(plant.oscillators, axpy_symmetric(1.0, (d[0], d[1], d[2], d[3], d[4], d[5]), inertia)):
            return False
    return True


@inline
def _draw_body(draw, plant):
    """Write inertia and its change, both physical all along the law; False where 1000 draws gave none."""
    size = _draw_law(draw, plant)
    nominal, change = load_symmetric(plant.inertia), load_symmetric(plant.change)
    low = -1.0 if plant.law == _PERIODIC else 0.0
    for _ in range(_DRAWS_MAX):
        draw_scale(draw, plant)
        inertia = _draw_inertia(draw, nominal, plant.stream)
        if draw.change_given == 0:
            if plant.law >= _DEPLOYMENT:
                change = _draw_mass(plant, size, inertia)
            else:
                change = axpy_symmetric(size, inertia, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        o = plant.oscillators
        ends = fits(o, axpy_symmetric(low, change, inertia)) and fits(o, axpy_symmetric(1.0, change, inertia))
        if plant.law == _STATIC:
            ends = True
        if plant.law == _TABLE:
            ends = _fits_table(draw, plant, inertia)
        if ends and fits(o, inertia):
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
    plant.tachometer_stuck_wheel = plant.wheel_loss_wheel = -1
    if _happens(draw.gyro_dropout, stream):
        plant.gyro_dropout[0] = between(stream, first, last)
        plant.gyro_dropout[1] = plant.gyro_dropout[0] + between(
            stream, draw.gyro_dropout_duration[0], draw.gyro_dropout_duration[1]
        )
        plant.gyro_dropout_silent = 1 if _happens(draw.gyro_dropout_silent, stream) else 0
    if _happens(draw.tachometer_stuck, stream):
        plant.tachometer_stuck_wheel = np.int64(n * uniform(stream))
        plant.tachometer_stuck[0] = between(stream, first, last)
        plant.tachometer_stuck[1] = plant.tachometer_stuck[0] + between(
            stream, draw.tachometer_stuck_duration[0], draw.tachometer_stuck_duration[1]
        )
    if _happens(draw.wheel_loss, stream):
        plant.wheel_loss_wheel = np.int64(n * uniform(stream))
        plant.wheel_loss_start = between(stream, first, last)
        plant.wheel_loss_left = 1.0 - _within(stream, draw.wheel_loss_size)
    if draw.torque_delay[1] > 0:
        plant.torque_delay = np.int64(between(stream, draw.torque_delay[0], draw.torque_delay[1] + 1))
    if draw.gyro_bias_std > 0.0:
        for i in range(3):
            plant.gyro_bias[i] += draw.gyro_bias_std * normal(stream)


@inline
def _draw_gyro(draw, plant):
    """Write bias, scale and misalignment of the gyro; a tolerance of 0 draws nothing."""
    stream = plant.stream
    if draw.tolerance_gyro_bias > 0.0:
        for i in range(3):
            plant.gyro_bias[i] += draw.tolerance_gyro_bias * normal(stream)
    if draw.tolerance_gyro_scale > 0.0 or draw.tolerance_gyro_alignment > 0.0:
        plant.gyro_uncalibrated = 1
        for i in range(3):
            for j in range(3):
                std = draw.tolerance_gyro_scale if i == j else draw.tolerance_gyro_alignment
                plant.gyro_gain[i, j] = (1.0 if i == j else 0.0) + std * normal(stream)


@inline
def _draw_wheels(draw, plant):
    """Turn the nominal wheels into those as built; a tolerance of 0 draws nothing."""
    stream = plant.stream
    for k in range(plant.locked.shape[0]):
        if draw.tolerance_wheel_inertia > 0.0:
            plant.wheel_inertia[k] *= 1.0 + draw.tolerance_wheel_inertia * normal(stream)
        if draw.tolerance_wheel_alignment > 0.0:
            axis = wheel_axis(plant.axes, k)
            tilt = normal(stream), normal(stream), normal(stream)
            across = axpy(-dot(tilt, axis), axis, tilt)
            built = axpy(draw.tolerance_wheel_alignment, across, axis)
            length = norm(built)
            for i in range(3):
                plant.axes[i, k] = built[i] / length


@outline
def draw_plant(draw, plant):
    """Turn the nominal `plant` into a drawn one, by its own stream; False where no inertia is physical.

    The disturbance has half its variance constant and half periodic with the orbit.
    """
    stream = plant.stream
    if not _draw_body(draw, plant):
        return False
    if plant.oscillators.mass.shape[0] > 0:
        draw_oscillators(draw, plant)
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
        square = 0.0
        for i in range(4):
            plant.attitude[i] = normal(stream)
            square += plant.attitude[i] ** 2
        for i in range(4):
            plant.attitude[i] /= np.sqrt(square)
    _draw_gyro(draw, plant)
    _draw_wheels(draw, plant)
    draw_delay(draw.tolerance_tachometer_delay, plant)
    set_momenta(plant)
    set_speeds(plant)
    if plant.sampling.on != 0:
        begin_sampling(plant)
    if draw.faulty != 0:
        _draw_faults(draw, plant)
    if plant.tracker.on != 0:
        begin_tracker(plant)
    if plant.operations.on != 0:
        begin_operations(plant)
    return True
