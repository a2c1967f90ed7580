"""What planners compute for every candidate, compiled: the covariance along rates, and local search of plans."""

from __future__ import annotations

import numpy as np

from satid_gym.control.deadbeat import allocate, reach, storable
from satid_gym.core import momentum_filter
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
from satid_gym.core.jit import inline, kernel
from satid_gym.core.kalman import estimated_inertia
from satid_gym.core.random import uniform
from satid_gym.core.records import LOGDET
from satid_gym.core.reward import spread


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
def _follow_command(belief, inertia, free, omega, wanted, build, period, wheel):
    """Rate a decision after `omega` when `RateLoop` is told `wanted`, rad/s; free is J - A j A^T and its inverse."""
    allocation, _, max_torque, max_spin = build
    momentum, tau = load(belief.mean), load(belief.mean[3 + belief.prior_theta.shape[0] :])
    stored = subtract(momentum, multiply(inertia, omega))
    for k in range(allocation.shape[0]):
        wheel[0, k] = allocate(allocation, stored, k)
    wanted = storable(wanted, momentum, inertia, (belief.axes, allocation, max_spin), wheel[0], wheel[1])
    wheels = (belief.axes, allocation, max_torque)
    return reach(omega, wanted, (momentum, tau), free, wheels, period, wheel[0], wheel[1])


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
def _fly(trail, errors, omegas, work, cap, plan, first, ahead, build, step, steps, counting, most, wheel, rate):
    """Nats gained (where counting) by a plan from its decision `first` on; it stops where the error passes `most`.

    Row d of trail, omegas and errors is what decision d begins with: belief, rate, sum over steps of the error so far.
    """
    inertia = estimated_inertia(trail[first])
    loose = axpy_symmetric(-1.0, load_symmetric(build[1]), inertia)
    free = (loose, inverse(loose))
    gained = 0.0
    for d in range(first, ahead):
        trail[d + 1] = trail[d]
        belief, omega, total = trail[d + 1], load(omegas[d]), errors[d]
        x, y, z = load(plan[d])
        wanted = (x * cap[0], y * cap[1], z * cap[2])
        end = _follow_command(belief, inertia, free, omega, wanted, build, step * steps, wheel)
        change = subtract(end, omega)
        for s in range(steps):
            _turn(belief, work, build[0], inertia, axpy((s + 1.0) / steps, change, omega), step, wheel[0], rate)
            if counting:
                gained += spread(belief, work, LOGDET)
            momentum_filter.condition(belief, work, rate)
            if counting:
                gained -= spread(belief, work, LOGDET)
            size, error = _frobenius(belief)
            total += error / size
        store(omegas[d + 1], end)
        errors[d + 1] = total
        if total > most:
            errors[ahead] = total
            break
    return gained


@inline
def _edit(plan, ahead, stream):
    """Change one axis of a plan: all reversals or one, sooner or later; or reverse it for a while or from then on."""
    k = np.int64(3.0 * uniform(stream))
    kind, start = uniform(stream), np.int64(ahead * uniform(stream))
    all_sooner, all_later, one_sooner, one_later = kind < 0.1, kind < 0.2, 0.2 <= kind < 0.4, 0.4 <= kind < 0.6
    short = one_sooner or one_later or uniform(stream) < 0.6
    span = 1 - np.int64((2.0 if short else 12.0) * np.log(uniform(stream)))
    if all_sooner:
        for t in range(ahead):
            plan[t, k] = plan[min(t + span, ahead - 1), k]
        return
    if all_later:
        for t in range(ahead - 1, -1, -1):
            plan[t, k] = plan[max(t - span, 0), k]
        return
    if one_sooner or one_later:
        for _ in range(ahead):  # on to a reversal, over the end
            if start > 0 and plan[start, k] != plan[start - 1, k]:
                break
            start = (start + 1) % ahead
    if one_sooner:
        start -= span
    end = ahead if kind > 0.85 else min(start + span, ahead)
    for t in range(max(start, 0), end):
        plan[t, k] = -plan[t, k]


def _build_follow(fingerprint):
    def follow(first, beliefs, work, before, after, speed, allocation, step, steps, mean, spin):
        """Bring the covariances to the present observation: (N, 3) rates before and after, (N, n) wheel speeds."""
        fingerprint  # noqa: B018
        wheel, rate = np.empty(speed.shape[1]), np.empty(3)
        for i in range(beliefs.shape[0]):
            belief = beliefs[i]
            if first:
                momentum_filter.start(belief, work[0], after[i], speed[i])
            else:
                inertia, change = estimated_inertia(belief), subtract(load(after[i]), load(before[i]))
                for s in range(steps):
                    end = axpy((s + 1.0) / steps, change, load(before[i]))
                    _turn(belief, work[0], allocation, inertia, end, step, wheel, rate)
                    momentum_filter.condition(belief, work[0], rate)
            belief.mean[:] = mean[i]
            belief.wheel_input[:3] = spin[i]

    return follow


def _build_forecast_many(fingerprint):
    def forecast_many(beliefs, trail, work, start, caps, commands, build, step, steps, gained, error):
        """See `Planner.forecast`; start and caps (N, 3), commands (N or 1, C, H, 3), gained and error (N, C)."""
        fingerprint  # noqa: B018
        ahead = commands.shape[2]
        wheel, rate = np.empty((2, build[0].shape[0])), np.empty(3)
        omegas, errors = np.empty((ahead + 1, 3)), np.zeros(ahead + 1)
        for i in range(beliefs.shape[0]):
            row = min(i, commands.shape[0] - 1)
            trail[0], omegas[0] = beliefs[i], start[i]
            for c in range(commands.shape[1]):
                gained[i, c] = _fly(
                    trail, errors, omegas, work[0], caps[i], commands[row, c], 0, ahead, build, step, steps, True,
                    np.inf, wheel, rate,
                )  # fmt: skip
                error[i, c] = errors[ahead] / (ahead * steps)

    return forecast_many


def _build_improve_many(fingerprint):
    def improve_many(beliefs, trail, other, work, start, caps, plans, streams, edits, ahead, build, step, steps):
        """See `Planner.improve`; start and caps (N, 3), plans (N, H, 3), streams (N, 4)."""
        fingerprint  # noqa: B018
        wheel, rate, trial = np.empty((2, build[0].shape[0])), np.empty(3), np.empty(plans.shape[1:])
        omegas, errors = np.empty((ahead + 1, 3)), np.zeros(ahead + 1)
        others, sums = np.empty((ahead + 1, 3)), np.zeros(ahead + 1)
        for i in range(beliefs.shape[0]):
            plan, cap = plans[i], caps[i]
            trail[0], omegas[0] = beliefs[i], start[i]
            _fly(
                trail, errors, omegas, work[0], cap, plan, 0, ahead, build, step, steps, False, np.inf, wheel, rate
            )  # fmt: skip
            for _ in range(edits):
                trial[:] = plan
                _edit(trial, ahead, streams[i])
                if uniform(streams[i]) < 0.5:
                    _edit(trial, ahead, streams[i])
                first = 0  # until then the trial is the plan
                while first < ahead and (trial[first] == plan[first]).all():
                    first += 1
                if first == ahead:
                    continue
                other[first], others[first], sums[first] = trail[first], omegas[first], errors[first]
                _fly(
                    other, sums, others, work[0], cap, trial, first, ahead, build, step, steps, False, errors[ahead],
                    wheel, rate,
                )  # fmt: skip
                if sums[ahead] < errors[ahead]:
                    plan[:] = trial
                    for d in range(first + 1, ahead + 1):
                        trail[d], omegas[d], errors[d] = other[d], others[d], sums[d]

    return improve_many


follow = kernel(_build_follow)
forecast_many = kernel(_build_forecast_many)
improve_many = kernel(_build_improve_many)
