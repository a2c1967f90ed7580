"""Integration of the truth over a sample, with events met exactly.

Steps of J, bends of its law and wheels that reach their speed limit end a step of the integrator.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import axpy, axpy_symmetric, dot, inverse, load, multiply, norm, subtract
from satid_gym.core.jit import inline, outline
from satid_gym.core.truth import friction, oscillators
from satid_gym.core.truth.disturbance import orbit_phases
from satid_gym.core.truth.dynamics import conditions, derivative, free_wheel_inertia, set_speeds, sum_free, write_speeds
from satid_gym.core.truth.increments import add_increments
from satid_gym.core.truth.inertia_law import inertia_at, law_turn, next_bend, varies
from satid_gym.core.truth.speed_limit import AT_LIMIT, hold_or_release, limit_speeds, overspeed, present_overspeed
from satid_gym.core.truth.state import add_state, axpy_state, load_state, store_state
from satid_gym.core.truth.step import take_step
from satid_gym.core.wheels import sum_wheels

_TURN_MAX = 0.5  # rad, that body and momentum may turn against each other in one Runge-Kutta step
_STEPS_MAX = 10_000.0
_GROWTH_MAX = 1e-8  # of |M| in one Runge-Kutta step, relative to M and A h; beyond it the step is halved
_HALVINGS_MAX = 200  # in one `advance`; after them a step is taken as it comes
_EVENTS_MAX = 100  # in one `advance`; after them wheels at their limit stay there until its end
_TRIALS_MAX = 60  # of the search for the moment a wheel reaches its limit


@outline
def _rk4(plant, torque, h):
    """State, A h and omega after h seconds of constant motor torque, by the classical Runge-Kutta method.

    The fourth value is the error of |M|^2.

    M turns, and only torque from outside changes its size: d|M|^2/dt = 2 M . tau. What the method adds to its own
    quadrature of that is error, and its slopes m_i tell how much: |sum h b_i m_i|^2 - 2 h^2 sum b_i a_ij m_i . m_j.
    Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), theorem IV.2.2.
    """
    t, x = plant.time, load_state(plant)
    free = free_wheel_inertia(plant)
    start = sum_wheels(plant.axes, plant.wheel_momentum)
    push = sum_free(plant, torque)
    half, end = axpy(0.5 * h, push, start), axpy(h, push, start)
    rubs, middle_half = plant.rubs != 0, half
    first = middle = last = conditions(plant, free, t)
    if varies(plant):
        middle, last = conditions(plant, free, t + 0.5 * h), conditions(plant, free, t + h)
    phases = orbit_phases(plant, t, 0.5 * h)
    o = plant.oscillators
    oscillators.begin_stage(o, 0.0, 0)
    k1, omega = derivative(plant, first, phases[0], x, start, 0)
    if rubs:
        half = friction.wheels_after(plant, torque, 0, h, omega)
    oscillators.begin_stage(o, 0.5 * h, 0)
    k2, omega = derivative(plant, middle, phases[1], axpy_state(0.5 * h, k1, x), half, 1)
    if rubs:
        middle_half = friction.wheels_after(plant, torque, 1, h, omega)
    oscillators.begin_stage(o, 0.5 * h, 1)
    k3, omega = derivative(plant, middle, phases[1], axpy_state(0.5 * h, k2, x), middle_half, 2)
    if rubs:
        end = friction.wheels_after(plant, torque, 2, h, omega)
    oscillators.begin_stage(o, h, 2)
    k4, omega = derivative(plant, last, phases[2], axpy_state(h, k3, x), end, 3)
    if rubs:
        end = friction.wheels_after(plant, torque, 3, h, omega)
    oscillators.end_step(o, h)
    slope = axpy_state(2.0, add_state(k2, k3), add_state(k1, k4))
    m1, m2, m3, m4, k = k1[0], k2[0], k3[0], k4[0], h / 6.0
    error = k * k * dot(slope[0], slope[0]) - 2.0 * h * k * (dot(m1, m2) + dot(m2, m3) + dot(m3, m4))
    state = axpy_state(k, slope, x)
    residual = subtract(state[0], end)
    if o.mass.shape[0] == 0:
        omega = multiply(last[2], residual)
    else:
        omega = oscillators.rate_at(o, last[1], residual, o.stage[0], o.stage[1])
    return state, end, omega, abs(error)


@inline
def _keeps_size(m, wheels, error):
    """Whether a step to M and A h that adds `error` to |M|^2 keeps |M|."""
    size = dot(m, m)
    # not "<=": a smaller step gains nothing where the error is not a number
    return not error > _GROWTH_MAX * np.sqrt(size) * np.sqrt(size + dot(wheels, wheels))


@outline
def _until_limit(plant, torque, h, over):
    """The time in (0, h) at which the first wheel reaches its limit, by the Illinois method."""
    low, high = 0.0, h
    f_low, f_high = min(present_overspeed(plant), -AT_LIMIT), over
    last = 0
    for _ in range(_TRIALS_MAX):
        h = high - f_high * (high - low) / (f_high - f_low)
        _state, _wheels, omega, _error = _rk4(plant, torque, h)
        f = overspeed(plant, torque if plant.rubs == 0 else plant.net_torque, h, omega)
        if abs(f) <= 0.5 * AT_LIMIT:
            return h
        if f > 0.0:
            high, f_high = h, f
            if last == 1:
                f_low *= 0.5
            last = 1
        else:
            low, f_low = h, f
            if last == -1:
                f_high *= 0.5
            last = -1
    return low if low > 0.0 else high


@outline
def integrate(plant, torque, duration):
    """Move the plant on by `duration` seconds of constant motor torque (n,), already within its limit.

    One Runge-Kutta step, or several where J bends or a wheel reaches its limit on the way, or where one step would not
    keep |M|.
    """
    end = plant.time + duration
    events = halvings = 0
    net = torque if plant.rubs == 0 else plant.net_torque
    while plant.time < end:
        if plant.rubs != 0:
            friction.write_net_torque(plant, torque)
        hold_or_release(plant, net, events > _EVENTS_MAX)
        stop = next_bend(plant, end)
        if plant.rubs != 0:
            stop = min(stop, plant.time + friction.longest_step(plant, torque, stop - plant.time))
        h = stop - plant.time
        while True:
            state, wheels, omega, error = _rk4(plant, torque, h)
            if halvings >= _HALVINGS_MAX or _keeps_size(state[0], wheels, error):
                break
            halvings += 1
            h *= 0.5
            stop = plant.time + h
        over = overspeed(plant, net, h, omega)
        if over > 0.5 * AT_LIMIT and events <= _EVENTS_MAX:
            h = _until_limit(plant, torque, h, over)
            stop = min(plant.time + h, end)
            state, wheels, omega, _error = _rk4(plant, torque, h)
            events += 1
        if plant.sampling.on != 0:
            _state, _wheels, middle, _error = _rk4(plant, torque, 0.5 * h)
            state, wheels, omega, _error = _rk4(plant, torque, h)  # again, for what it leaves in the plant's records
            add_increments(plant, net, h, middle, omega)
        for k in range(torque.shape[0]):
            if plant.locked[k] == 0:
                plant.wheel_momentum[k] += h * net[k]
        store_state(plant, state)
        plant.time = stop
        if take_step(plant):
            set_speeds(plant)
        else:
            write_speeds(plant, omega)
        limit_speeds(plant)


@inline
def advance(plant, torque, duration):
    """Move the plant on by `duration` seconds of constant motor torque (n,), in as many steps as the body may turn far.

    One step in all but coarse sampling. Body rate and nutation are at most (|M| + |A h|) tr(J^-1), J without the free
    wheels; the phase of a periodic inertia law and that of oscillators count as well.
    """
    m, a = load(plant.momentum), sum_wheels(plant.axes, plant.wheel_momentum)
    f = inverse(axpy_symmetric(-1.0, free_wheel_inertia(plant), inertia_at(plant, plant.time)))
    push = duration * norm(sum_free(plant, torque))
    turn = duration * (norm(m) + norm(a) + push) * (f[0] + f[1] + f[2])
    if plant.oscillators.mass.shape[0] > 0:
        turn += oscillators.step_turn(plant.oscillators, duration)
    steps = min(max(np.ceil((turn + law_turn(plant, duration)) / _TURN_MAX), 1.0), _STEPS_MAX)
    start = plant.time
    for step in range(np.int64(steps)):
        integrate(plant, torque, start + (step + 1) / steps * duration - plant.time)
