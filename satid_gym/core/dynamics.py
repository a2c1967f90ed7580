"""Truth: a rigid body with reaction wheels, in momentum form.

    dM/dt = -omega x M + tau_ext       dh/dt = u       dq/dt = q * omega / 2
    omega = (J - A j A^T)^-1 (M - A h)                 Omega = h / j - A^T omega

Motor torque is internal and does not appear in dM/dt, so momentum is conserved by construction, when a wheel
saturates and when J varies as well. A wheel at its speed limit is locked to the body at that speed: it
contributes the constant j Omega to M and its inertia to the body, which is the same as the motor giving
just the torque that holds the limit. Steps of J, knots of its table and wheels reaching their limit are met
exactly: the step of the integrator ends there.
Source: Hughes, Spacecraft Attitude Dynamics (1986), ch. 6; the locked form follows from it.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    cross,
    dot,
    inverse,
    load,
    load_symmetric,
    multiply,
    norm,
    store,
    subtract,
)
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import DRIFT, PERIODIC, STEP, TABLE

_AT_LIMIT = 1e-11  # relative to the speed limit
_MOST_TURN = 0.5  # rad, that body and momentum may turn against each other in one Runge-Kutta step
_MOST_STEPS = 10_000.0
_MOST_DRIFT = 1e-8  # of |M| in one Runge-Kutta step, relative to M and A h; beyond it the step is halved
_MOST_HALVINGS = 200  # within one advance; past it a step is taken as it comes
_MOST_EVENTS = 100  # within one advance; past it wheels at their limit stay there until its end
_MOST_TRIALS = 60  # of the search for the moment a wheel reaches its limit


@inline
def law_factor(plant, t):
    """f(t) of J(t) = inertia + f(t) change."""
    if plant.law == STEP:
        return np.float64(plant.stepped)
    if plant.law == DRIFT:
        return min(t / plant.law_time, 1.0)
    if plant.law == PERIODIC:
        return np.sin(2.0 * np.pi * plant.law_frequency * t + plant.law_phase)
    return 0.0


@inline
def law_slope(plant, t):
    """df/dt between steps, 1/s."""
    if plant.law == DRIFT:
        return 1.0 / plant.law_time if t < plant.law_time else 0.0
    if plant.law == PERIODIC:
        w = 2.0 * np.pi * plant.law_frequency
        return w * np.cos(w * t + plant.law_phase)
    return 0.0


@inline
def _knot_before(plant, t):
    """Index of the last knot of the table at or before t; -1 before the first."""
    low, high = -1, plant.knots
    while high - low > 1:
        middle = (low + high) // 2
        if plant.knot_time[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@inline
def _knot_change(plant, i):
    d = plant.knot_change[i]
    return d[0], d[1], d[2], d[3], d[4], d[5]


@outline
def _table_change(plant, t):
    """D(t) of a table (symmetric): linear between knots, held before the first and after the last."""
    i = _knot_before(plant, t)
    if i < 0:
        return _knot_change(plant, 0)
    if i == plant.knots - 1:
        return _knot_change(plant, i)
    share = (t - plant.knot_time[i]) / (plant.knot_time[i + 1] - plant.knot_time[i])
    rest = axpy_symmetric(-share, _knot_change(plant, i), _knot_change(plant, i))
    return axpy_symmetric(share, _knot_change(plant, i + 1), rest)


@outline
def _table_slope(plant, t):
    """dD/dt of a table just after t (symmetric), kg m^2/s."""
    i = _knot_before(plant, t)
    if i < 0 or i == plant.knots - 1:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    k = 1.0 / (plant.knot_time[i + 1] - plant.knot_time[i])
    a, b = _knot_change(plant, i), _knot_change(plant, i + 1)
    return (
        k * (b[0] - a[0]),
        k * (b[1] - a[1]),
        k * (b[2] - a[2]),
        k * (b[3] - a[3]),
        k * (b[4] - a[4]),
        k * (b[5] - a[5]),
    )


@inline
def inertia_at(plant, t):
    """True inertia J(t), wheels locked (symmetric)."""
    if plant.law == TABLE:
        return axpy_symmetric(1.0, _table_change(plant, t), load_symmetric(plant.inertia))
    return axpy_symmetric(law_factor(plant, t), load_symmetric(plant.change), load_symmetric(plant.inertia))


@inline
def to_body(q, v):
    """An inertial vector in the body frame; q is body to inertial, scalar last."""
    a = (-q[0], -q[1], -q[2])
    t = cross(a, v)
    t = (2.0 * t[0], 2.0 * t[1], 2.0 * t[2])
    return add(axpy(q[3], t, v), cross(a, t))


@inline
def external_torque(plant, t, q, inertia):
    """Gravity gradient 3 n^2 r x J r, solar pressure, constant and orbit-periodic torque, body frame, N m.

    The nadir r is the inertial (cos nt, sin nt, 0) seen from the body. Source: Hughes (1986), ch. 8.
    """
    cosine, sine = np.cos(plant.orbit_rate * t), np.sin(plant.orbit_rate * t)
    tau = axpy(cosine, load(plant.torque_cosine), load(plant.torque_constant))
    tau = axpy(sine, load(plant.torque_sine), tau)
    tau = add(tau, cross(load(plant.solar_offset), to_body(q, load(plant.solar_force))))
    if plant.gravity_gradient != 0:
        r = to_body(q, (cosine, sine, 0.0))
        tau = axpy(3.0 * plant.orbit_rate**2, cross(r, multiply(inertia, r)), tau)
    return tau


@inline
def wheel_axis(axes, k):
    """Spin axis of wheel k."""
    return axes[0, k], axes[1, k], axes[2, k]


@inline
def along_axis(axes, k, v):
    """Component of a body vector along the axis of wheel k."""
    return axes[0, k] * v[0] + axes[1, k] * v[1] + axes[2, k] * v[2]


@inline
def sum_wheels(axes, values):
    """A v: what one number for each wheel comes to in the body frame."""
    total = (0.0, 0.0, 0.0)
    for k in range(values.shape[0]):
        total = axpy(values[k], wheel_axis(axes, k), total)
    return total


@inline
def _sum_free(plant, values):
    """A v over the wheels that are not locked."""
    total = (0.0, 0.0, 0.0)
    for k in range(values.shape[0]):
        if plant.locked[k] == 0:
            total = axpy(values[k], wheel_axis(plant.axes, k), total)
    return total


@inline
def _free_wheel_inertia(plant):
    """A j A^T over the wheels that are not locked (symmetric)."""
    s = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(plant.locked.shape[0]):
        if plant.locked[k] == 0:
            x, y, z = wheel_axis(plant.axes, k)
            s = axpy_symmetric(plant.wheel_inertia[k], (x * x, y * y, z * z, x * y, x * z, y * z), s)
    return s


@inline
def _rate_of(inertia, free, momentum, wheels):
    """omega = (J - A j A^T)^-1 (M - A h)."""
    return multiply(inverse(axpy_symmetric(-1.0, free, inertia)), subtract(momentum, wheels))


@outline
def set_speeds(plant):
    """Write rate and wheel speed from the momenta at plant.time."""
    wheels = sum_wheels(plant.axes, plant.wheel_momentum)
    inertia = inertia_at(plant, plant.time)
    omega = _rate_of(inertia, _free_wheel_inertia(plant), load(plant.momentum), wheels)
    store(plant.rate, omega)
    for k in range(plant.locked.shape[0]):
        speed = plant.wheel_momentum[k] / plant.wheel_inertia[k]
        if plant.locked[k] == 0:
            speed -= along_axis(plant.axes, k, omega)
        plant.wheel_speed[k] = speed


@inline
def spin_momentum(plant, k):
    """Absolute spin momentum h = j (Omega + A^T omega) of wheel k, N m s."""
    return plant.wheel_inertia[k] * (plant.wheel_speed[k] + along_axis(plant.axes, k, load(plant.rate)))


@inline
def set_momenta(plant):
    """Write the momenta from rate and wheel speed at plant.time; no wheel is locked."""
    momentum = multiply(inertia_at(plant, plant.time), load(plant.rate))
    for k in range(plant.locked.shape[0]):
        plant.locked[k] = 0
        plant.wheel_momentum[k] = spin_momentum(plant, k)
        spin = plant.wheel_inertia[k] * plant.wheel_speed[k]
        momentum = axpy(spin, wheel_axis(plant.axes, k), momentum)
    store(plant.momentum, momentum)


@outline
def _slopes(plant, free, t, m, q, wheels):
    """dM/dt and dq/dt of the state (M, q); `free` is A j A^T and `wheels` A h of the wheels."""
    inertia = inertia_at(plant, t)
    omega = _rate_of(inertia, free, m, wheels)
    torque = external_torque(plant, t, q, inertia)
    x, y, z = omega
    spin = (
        0.5 * (q[3] * x + q[1] * z - q[2] * y),
        0.5 * (q[3] * y + q[2] * x - q[0] * z),
        0.5 * (q[3] * z + q[0] * y - q[1] * x),
        -0.5 * (q[0] * x + q[1] * y + q[2] * z),
    )
    return add(cross(m, omega), torque), spin


@inline
def _axpy4(k, a, b):
    return k * a[0] + b[0], k * a[1] + b[1], k * a[2] + b[2], k * a[3] + b[3]


@outline
def _rk4(plant, torque, h):
    """(M, q, A h) after h seconds of constant motor torque, by the classical Runge-Kutta method, and its drift.

    M turns, and only torque from outside changes its size: d|M|^2/dt = 2 M . tau. What the method adds to its own
    quadrature of that is error, and its slopes m_i tell how much: |sum h b_i m_i|^2 - 2 h^2 sum b_i a_ij m_i . m_j.
    Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), theorem IV.2.2.
    """
    t = plant.time
    m, a = load(plant.momentum), plant.attitude
    q = (a[0], a[1], a[2], a[3])
    free = _free_wheel_inertia(plant)
    start = sum_wheels(plant.axes, plant.wheel_momentum)
    push = _sum_free(plant, torque)
    half, end = axpy(0.5 * h, push, start), axpy(h, push, start)
    m1, q1 = _slopes(plant, free, t, m, q, start)
    m2, q2 = _slopes(plant, free, t + 0.5 * h, axpy(0.5 * h, m1, m), _axpy4(0.5 * h, q1, q), half)
    m3, q3 = _slopes(plant, free, t + 0.5 * h, axpy(0.5 * h, m2, m), _axpy4(0.5 * h, q2, q), half)
    m4, q4 = _slopes(plant, free, t + h, axpy(h, m3, m), _axpy4(h, q3, q), end)
    k = h / 6.0
    slope = axpy(2.0, add(m2, m3), add(m1, m4))
    drift = k * k * dot(slope, slope) - 2.0 * h * k * (dot(m1, m2) + dot(m2, m3) + dot(m3, m4))
    m = axpy(k, slope, m)
    q = _axpy4(k, _axpy4(2.0, q2, _axpy4(2.0, q3, _axpy4(1.0, q1, q4))), q)
    return m, q, end, abs(drift)


@inline
def _keeps_size(m, wheels, drift):
    """Whether a step to M and A h that adds `drift` to |M|^2 keeps |M|."""
    size = dot(m, m)
    # not "<=": what is no number has nothing to gain from smaller steps
    return not drift > _MOST_DRIFT * np.sqrt(size) * np.sqrt(size + dot(wheels, wheels))


@inline
def _at_limit(plant, k):
    return abs(plant.wheel_speed[k]) >= plant.wheel_speed_max[k] * (1.0 - _AT_LIMIT)


@outline
def _hold_or_release(plant, torque, stay):
    """Lock the wheels at their limit that the motor pushes outward, release those it pulls back."""
    near = False
    for k in range(torque.shape[0]):
        near = near or _at_limit(plant, k)
    if not near:
        return
    t, omega, a = plant.time, load(plant.rate), plant.attitude
    inertia = inertia_at(plant, t)
    tau = external_torque(plant, t, (a[0], a[1], a[2], a[3]), inertia)
    push = subtract(add(cross(load(plant.momentum), omega), tau), _sum_free(plant, torque))
    push = axpy(-law_slope(plant, t), multiply(load_symmetric(plant.change), omega), push)
    if plant.law == TABLE:
        push = subtract(push, multiply(_table_slope(plant, t), omega))
    free = _free_wheel_inertia(plant)
    acceleration = multiply(inverse(axpy_symmetric(-1.0, free, inertia)), push)
    for k in range(torque.shape[0]):
        side = 1.0 if plant.wheel_speed[k] > 0.0 else -1.0
        holding = plant.wheel_inertia[k] * along_axis(plant.axes, k, acceleration)
        if _at_limit(plant, k) and (stay or side * (torque[k] - holding) >= 0.0):
            plant.locked[k] = 1
            plant.wheel_momentum[k] = plant.wheel_inertia[k] * side * plant.wheel_speed_max[k]
        elif plant.locked[k] == 1:
            plant.locked[k] = 0
            plant.wheel_momentum[k] = spin_momentum(plant, k)


@inline
def _overspeed(plant, torque, h, m, wheels):
    """How far beyond its limit the fastest free wheel is after h seconds, relative to its limit."""
    inertia = inertia_at(plant, plant.time + h)
    omega = _rate_of(inertia, _free_wheel_inertia(plant), m, wheels)
    worst = -1.0
    for k in range(torque.shape[0]):
        if plant.locked[k] == 0:
            momentum = plant.wheel_momentum[k] + h * torque[k]
            speed = momentum / plant.wheel_inertia[k] - along_axis(plant.axes, k, omega)
            worst = max(worst, abs(speed) / plant.wheel_speed_max[k] - 1.0)
    return worst


@outline
def _until_limit(plant, torque, h, over):
    """The time in (0, h) at which the first wheel reaches its limit, by the Illinois method."""
    low, high = 0.0, h
    f_low, f_high = -1.0, over
    for k in range(torque.shape[0]):
        if plant.locked[k] == 0:
            f_low = max(f_low, abs(plant.wheel_speed[k]) / plant.wheel_speed_max[k] - 1.0)
    f_low = min(f_low, -_AT_LIMIT)
    last = 0
    for _ in range(_MOST_TRIALS):
        h = high - f_high * (high - low) / (f_high - f_low)
        m, _q, wheels, _drift = _rk4(plant, torque, h)
        f = _overspeed(plant, torque, h, m, wheels)
        if abs(f) <= 0.5 * _AT_LIMIT:
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


@inline
def _limit_speeds(plant):
    """Lock wheels that a step of J has thrown beyond their limit; the body takes up the difference."""
    beyond = False
    for k in range(plant.locked.shape[0]):
        limit = plant.wheel_speed_max[k]
        if plant.locked[k] == 0 and abs(plant.wheel_speed[k]) > limit:
            side = 1.0 if plant.wheel_speed[k] > 0.0 else -1.0
            plant.locked[k] = 1
            plant.wheel_momentum[k] = plant.wheel_inertia[k] * side * limit
            beyond = True
    if beyond:
        set_speeds(plant)


@outline
def advance(plant, torque, duration):
    """Move the plant on by `duration` seconds of constant motor torque (n,), already within its limit.

    One Runge-Kutta step, or several where J steps, its drift ends, its table has a knot or a wheel reaches its limit
    on the way, or where one step would not keep |M|.
    """
    end = plant.time + duration
    events = halvings = 0
    while plant.time < end:
        _hold_or_release(plant, torque, events > _MOST_EVENTS)
        stop = end
        bends = plant.law == DRIFT and plant.time < plant.law_time
        if (bends or (plant.law == STEP and plant.stepped == 0)) and plant.law_time < end:
            stop = plant.law_time
        elif plant.law == TABLE:
            following = _knot_before(plant, plant.time) + 1
            if following < plant.knots:
                stop = min(stop, plant.knot_time[following])
        h = stop - plant.time
        while True:
            m, q, wheels, drift = _rk4(plant, torque, h)
            if halvings >= _MOST_HALVINGS or _keeps_size(m, wheels, drift):
                break
            halvings += 1
            h *= 0.5
            stop = plant.time + h
        over = _overspeed(plant, torque, h, m, wheels)
        if over > 0.5 * _AT_LIMIT:
            h = _until_limit(plant, torque, h, over)
            stop = min(plant.time + h, end)
            m, q, wheels, _drift = _rk4(plant, torque, h)
            events += 1
        for k in range(torque.shape[0]):
            if plant.locked[k] == 0:
                plant.wheel_momentum[k] += h * torque[k]
        store(plant.momentum, m)
        scale = 1.0 / np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
        for i in range(4):
            plant.attitude[i] = scale * q[i]
        plant.time = stop
        if plant.law == STEP and stop >= plant.law_time:
            plant.stepped = 1
        set_speeds(plant)
        _limit_speeds(plant)


@inline
def travel(plant, torque, duration):
    """`advance` in as many steps as the body may turn far; one in all but coarse sampling.

    Body rate and nutation are at most (|M| + |A h|) tr(J^-1), J without the free wheels; the phase of a periodic
    law of the inertia counts as well.
    """
    m, a = load(plant.momentum), sum_wheels(plant.axes, plant.wheel_momentum)
    f = inverse(axpy_symmetric(-1.0, _free_wheel_inertia(plant), inertia_at(plant, plant.time)))
    push = duration * norm(_sum_free(plant, torque))
    turn = duration * (norm(m) + norm(a) + push) * (f[0] + f[1] + f[2])
    if plant.law == PERIODIC:
        turn += duration * 2.0 * np.pi * plant.law_frequency
    steps = min(max(np.ceil(turn / _MOST_TURN), 1.0), _MOST_STEPS)
    start = plant.time
    for step in range(np.int64(steps)):
        advance(plant, torque, start + (step + 1) / steps * duration - plant.time)
