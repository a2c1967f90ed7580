"""Forecast of the covariance along candidate plans of body rates, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from satid_gym.control.deadbeat import reach
from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    cross,
    inverse,
    load,
    load_symmetric,
    multiply,
    store,
    subtract,
)
from satid_gym.core.belief import momentum_filter, momentum_start
from satid_gym.core.belief.kalman import estimated_inertia
from satid_gym.core.control.allocation import allocate, storable
from satid_gym.core.jit import inline, kernel
from satid_gym.core.records import Criterion
from satid_gym.core.reward import dispersion, nats
from satid_gym.core.wheels import is_in_band

_LOGDET = int(Criterion.LOGDET)
_BAND_PENALTY = 30.0  # factor on the error of a step in which a wheel is in the band


class World(NamedTuple):
    """Satellite and clock of a forecast.

    Attributes:
        allocation: (n, 3) pseudo-inverse of the wheel axes.
        rotor_inertia: (3, 3) A j A^T, kg m^2.
        max_torque, max_spin: (n,) limits of the wheels, N m and N m s, the latter less its margin.
        avoided: (low, high) band of wheel speed that operators avoid, rad/s; none where they are equal.
        step: s.
        steps: in a decision.
    """

    allocation: np.ndarray
    rotor_inertia: np.ndarray
    max_torque: np.ndarray
    max_spin: np.ndarray
    avoided: np.ndarray
    step: float
    steps: int


class Start(NamedTuple):
    """Present of N episodes.

    Attributes:
        beliefs: (N,) records.
        rates: (N, 3) of the body, rad/s.
        caps: (N, 3) largest to be commanded, rad/s.
        null_speeds: (N, n) part of the wheels' speeds whose momenta cancel, rad/s.
    """

    beliefs: np.ndarray
    rates: np.ndarray
    caps: np.ndarray
    null_speeds: np.ndarray


class Observed(NamedTuple):
    """Decision that N episodes have just flown.

    Attributes:
        before, after: (N, 3) body rates at its start and end, rad/s.
        wheel_speed: (N, n) at its end, rad/s.
        mean: (N, size) state of the filter at its end.
        wheel_momentum: (N, 3) A j Omega at its end, N m s.
    """

    before: np.ndarray
    after: np.ndarray
    wheel_speed: np.ndarray
    mean: np.ndarray
    wheel_momentum: np.ndarray


class Trail(NamedTuple):
    """Forecast of one plan, by decision: row d is the start of decision d, the last row the end of the plan.

    Attributes:
        beliefs: (H + 1,) belief records.
        rates: (H + 1, 3) rad/s.
        errors: (H + 1,) sum over steps of the relative error that the filter expects, more where a wheel is in the
            band.
    """

    beliefs: np.ndarray
    rates: np.ndarray
    errors: np.ndarray

    @classmethod
    def of(cls, dtype: np.dtype, ahead: int) -> Trail:
        """Room for a plan of `ahead` decisions."""
        return cls(np.empty(ahead + 1, dtype), np.empty((ahead + 1, 3)), np.zeros(ahead + 1))


class Scratch(NamedTuple):
    """Scratch space: that of the filter (1,), of a value for each wheel (n,), and of a rate (3,)."""

    work: np.ndarray
    wheel: np.ndarray
    rate: np.ndarray


@inline
def _turn(belief, work, allocation, inertia, end, step, speed, rate):
    """Covariance one step on, at the end of which the body turns at `end`; the reading there is left in `rate`."""
    momentum, omega, p = load(belief.mean), momentum_filter.rate(belief), belief.prior_theta.shape[0]
    after = axpy(step, add(cross(momentum, omega), load(belief.mean[3 + p :])), momentum)
    stored = subtract(after, multiply(inertia, end))
    for k in range(speed.shape[0]):
        speed[k] = allocate(allocation, stored, k) / belief.wheel_inertia[k]
    momentum_filter.predict(belief, work, speed, step)
    store(rate, momentum_filter.rate(belief))  # the reading that is expected: it moves the covariance alone


@inline
def _follow_command(belief, inertia, free, omega, wanted, world, wheel):
    """Rate a decision after `omega` when `RateLoop` is told `wanted`, rad/s; free is J - A j A^T and its inverse."""
    allocation, period = world.allocation, world.step * world.steps
    momentum, tau = load(belief.mean), load(belief.mean[3 + belief.prior_theta.shape[0] :])
    stored = subtract(momentum, multiply(inertia, omega))
    for k in range(allocation.shape[0]):
        wheel[k] = allocate(allocation, stored, k)
    wheels = (belief.axes, allocation, world.max_spin)
    wanted = storable(wanted, momentum, inertia, wheels, wheel)
    wheels = (belief.axes, allocation, world.max_torque)
    return reach(omega, wanted, (momentum, tau), free, wheels, period, wheel)


@inline
def _frobenius(belief):
    """Norms of the inertia and of its error's standard deviation, kg m^2."""
    size = error = 0.0
    for k in range(belief.prior_theta.shape[0]):
        weight = 1.0 if k < 3 else 2.0
        size += weight * belief.mean[3 + k] ** 2
        error += weight * belief.covariance[3 + k, 3 + k]
    return np.sqrt(size), np.sqrt(error)


@inline
def fly_plan(trail, scratch, limits, plan, first, world, counting, error_max):
    """Nats gained (where counting) by a plan from its decision `first` on; it stops where the error is too large.

    Limits are the largest rates (3,) to be commanded and the part of the wheels' speeds (n,) whose momenta cancel,
    which stays. Outside the band alone a step gains what is counted, and inside it its error counts more.
    """
    cap, null_speed = limits
    inertia = estimated_inertia(trail.beliefs[first])
    J_free = axpy_symmetric(-1.0, load_symmetric(world.rotor_inertia), inertia)
    free = (J_free, inverse(J_free))
    work, steps, ahead = scratch.work[0], world.steps, trail.errors.shape[0] - 1
    gained = 0.0
    for d in range(first, ahead):
        trail.beliefs[d + 1] = trail.beliefs[d]
        belief, omega, total = trail.beliefs[d + 1], load(trail.rates[d]), trail.errors[d]
        x, y, z = load(plan[d])
        wanted = (x * cap[0], y * cap[1], z * cap[2])
        end = _follow_command(belief, inertia, free, omega, wanted, world, scratch.wheel)
        change = subtract(end, omega)
        for s in range(steps):
            now = axpy((s + 1.0) / steps, change, omega)
            _turn(belief, work, world.allocation, inertia, now, world.step, scratch.wheel, scratch.rate)
            in_band = False
            if world.avoided[1] > world.avoided[0]:
                for k in range(null_speed.shape[0]):
                    scratch.wheel[k] += null_speed[k]
                in_band = is_in_band(scratch.wheel, world.avoided)
            before = dispersion(belief, work, _LOGDET) if counting else 1.0
            momentum_filter.condition(belief, work, scratch.rate)
            if counting:
                nats_here = nats(belief, before / dispersion(belief, work, _LOGDET), _LOGDET)
                gained += 0.0 if in_band else nats_here
            size, error = _frobenius(belief)
            total += (_BAND_PENALTY if in_band else 1.0) * (error / size)
        store(trail.rates[d + 1], end)
        trail.errors[d + 1] = total
        if total > error_max:
            trail.errors[ahead] = total
            break
    return gained


@kernel
def follow(first, beliefs, seen, world, scratch):
    """Bring the covariances of beliefs (N,) to the present: `Observed`; the first time they start there."""
    wheel, rate, work = scratch.wheel, scratch.rate, scratch.work[0]
    for i in range(beliefs.shape[0]):
        belief = beliefs[i]
        if first:
            momentum_start.start(belief, work, seen.after[i], seen.wheel_speed[i])
        else:
            before = load(seen.before[i])
            inertia, change = estimated_inertia(belief), subtract(load(seen.after[i]), before)
            for s in range(world.steps):
                end = axpy((s + 1.0) / world.steps, change, before)
                _turn(belief, work, world.allocation, inertia, end, world.step, wheel, rate)
                momentum_filter.condition(belief, work, rate)
        belief.mean[:] = seen.mean[i]
        belief.wheel_input[:3] = seen.wheel_momentum[i]


@kernel
def forecast_many(start, trail, scratch, commands, world, gained, error):
    """See `Planner.forecast`; commands (N or 1, C, H, 3), gained and error (N, C)."""
    ahead = commands.shape[2]
    trail.errors[0] = 0.0
    for i in range(start.beliefs.shape[0]):
        row = min(i, commands.shape[0] - 1)
        trail.beliefs[0], trail.rates[0] = start.beliefs[i], start.rates[i]
        limits = (start.caps[i], start.null_speeds[i])
        for c in range(commands.shape[1]):
            gained[i, c] = fly_plan(trail, scratch, limits, commands[row, c], 0, world, True, np.inf)
            error[i, c] = trail.errors[ahead] / (ahead * world.steps)
