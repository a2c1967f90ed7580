"""Retraction: an update of the MomentumEKF whose errors are those of the body rate, not of the momentum.

While the body turns evenly its momentum tells nothing of its inertia: M - a = J omega holds for any J with the right M.
In the covariance that is a direction dM = L(omega) dtheta, which moves with the estimate of omega. Each correction of
omega, as of a gyro's bias, then makes a reading look like information on theta that it is not. In errors of the rate,

    d omega = J^-1 (dM - L(omega) dtheta - sum_k Omega_k de_k)

with e all errors of the wheels' momentum, and with what `modes` add to it, a reading has no derivative by theta, and
only a change of the rate in time, by the wheels, tells of it. So the mean is moved in (omega, theta, ...), M follows,
and the covariance of M is taken to the new omega and J. All this is done at one rate r, `reference_rate`:

    M - a goes from m to m + J' (r + d omega) - J r,   J' the new J

At the filter's own rate J^-1 m, which has the noise of the tachometers, as the innovation has, M would take up that
noise times the change of theta, at each reading with the same sign: J would grow for as long as the flight lasts.

A gyro of unknown scale has another such direction. Only the weak torque-free turning of M tells (1 + G) J^-1 from its
parts: with any s, dM = 0, d omega = -omega s, dtheta = theta s and dG = (1 + G) s give the same readings. It moves with
the estimates of omega and theta, so that corrections of both would pass for information on G, and pull it to one side
for as long as theta is taken to vary. So what lasts over an update is the error of what the gyro reads,
d omega + dG r to first order in G, and the error of theta relative to theta. Rotors of unknown inertia need the latter
as well. Where the rate goes from r to r + dr, dM has -J' dG dr in addition, and dtheta grows as theta does, that of a
product of inertia by the geometric mean of the growth of its two moments.

r follows d omega and the motion: the most likely rate y at once where that is beyond the noise of the tachometers, and
else a running mean of y, whose noise is hardly any excitation. A reference that stayed where it is within the noise
would be off the rate for minutes: motion that never was. Of a body that never moves even the running mean's noise would
tell something; so until an axis has moved r is the mean of its first readings, and it has moved where the running mean
is off that by more than the noise of both.

Where readings are aligned in time (`alignment`) their noise is correlated, and with these two rules the filter was
found overconfident: there m moves at J^-1 m, and r does not move within the noise.
Source: this project's design; its model is the invariant EKF, Barrau and Bonnabel, The invariant extended Kalman filter
as a stable observer (2017), where errors are chosen so that what cannot be observed does not depend on the estimate.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import add, axpy, inverse, load, multiply, store, store_symmetric, subtract
from satid_gym.core.belief import calibration, modes
from satid_gym.core.belief.kalman import estimated_inertia, inertia_of, propagate, write_times_regressor
from satid_gym.core.jit import inline, outline

EXCITATION_SIGMAS = 5.0  # standard deviations within which a rate, or its change, counts as noise, not excitation
_BEYOND = EXCITATION_SIGMAS**2
_FOLLOWING = 0.1  # share of the way that the running mean goes at a reading
_FIRST = 100  # readings whose mean is the reference until an axis has moved


@inline
def start_reference(belief, rate):
    """Take a first rate (3,), rad/s, for the reference."""
    store(belief.reference_rate, rate)
    store(belief.smoothed_rate, rate)
    for axis in range(3):
        belief.smoothed_count[axis], belief.has_moved[axis] = 1, 0


@inline
def _move_axis(belief, axis, likely, spin):
    """Move the reference about one axis to the most likely rate, which has noise of variance spin."""
    rate, smoothed, count, noise = belief.reference_rate, belief.smoothed_rate, belief.smoothed_count, spin * _BEYOND
    moves = (likely - rate[axis]) ** 2 > 2.0 * noise  # of two readings
    if moves:
        rate[axis] = smoothed[axis] = likely
        count[axis] = belief.has_moved[axis] = 1
    if moves or belief.alignment.gyro_line.shape[0] > 0:
        return
    count[axis] += 1
    share = 1.0 / count[axis]
    smoothed[axis] += max(share, _FOLLOWING) * (likely - smoothed[axis])
    if belief.has_moved[axis] == 0:
        if count[axis] <= _FIRST:
            rate[axis] += share * (likely - rate[axis])
        elif (smoothed[axis] - rate[axis]) ** 2 > (_FOLLOWING / (2.0 - _FOLLOWING) + 1.0 / _FIRST) * noise:
            belief.has_moved[axis] = 1
    if belief.has_moved[axis] != 0:
        rate[axis] = smoothed[axis]


@inline
def move_reference(belief, likely, spin):
    """Rate at which derivatives are taken, moved to the most likely rate; spin: its covariance by the tachometers."""
    for axis in range(3):
        _move_axis(belief, axis, likely[axis], spin[axis])
    return load(belief.reference_rate)


@inline
def begin(belief, work):
    """Note the mean before an update."""
    for i in range(belief.mean.shape[0]):
        work.prior_mean[i] = belief.mean[i]


@outline
def finish(belief, work):
    """Take mean and covariance of M after an update to the rate that it has found."""
    p, n, w = belief.prior_theta.shape[0], belief.calibration.spin_count, belief.calibration.spins
    scale, mean, prior, rate = belief.calibration.spin_scale, belief.mean, work.prior_mean, load(belief.reference_rate)
    flexible = belief.modes.coupling.shape[0]
    before = modes.body_inertia(belief, prior, inertia_of(prior[3 : 3 + p]))
    J_inv = inverse(before)
    carried = subtract(load(prior), load(belief.wheel_input))
    identity, turned, regressor, transition = work.jacobian[0], work.jacobian[1], work.regressor, work.transition
    first_mode = 6 + p
    if flexible > 0:
        modes.write_rate_errors(belief, prior, rate, work.rows)
        for i in range(flexible):
            d = load(belief.modes.d[i])
            carried = axpy(-prior[first_mode + modes.STATES * i + 1], d, carried)
        modes.refresh(belief)
    inertia = modes.body_inertia(belief, belief.mean, estimated_inertia(belief))
    _write_product(inertia, J_inv, turned)
    store_symmetric(identity, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    write_times_regressor(identity, rate, regressor)
    change = subtract(load(mean), load(prior))
    for k in range(p):
        d = mean[3 + k] - prior[3 + k]
        change = subtract(change, (d * regressor[0, k], d * regressor[1, k], d * regressor[2, k]))
    for j in range(first_mode, first_mode + modes.STATES * flexible):
        change = axpy(mean[j] - prior[j], modes.load_column(work.rows, j), change)
    lasting = change
    for k in range(n):
        if k == n - belief.alignment.noise_taps:
            lasting = change  # what an encoder's errors change was in no rate before
        for i in range(3):
            d = scale[k] * (mean[w + 3 * k + i] - prior[w + 3 * k + i])
            change = subtract(change, (d if i == 0 else 0.0, d if i == 1 else 0.0, d if i == 2 else 0.0))
    if belief.alignment.noise_taps == 0:
        lasting = change
    correction = multiply(J_inv, change)
    at = rate if belief.alignment.gyro_line.shape[0] == 0 else multiply(J_inv, carried)
    carried = add(carried, subtract(multiply(inertia, add(at, correction)), multiply(before, at)))
    for i in range(3):
        for j in range(transition.shape[1]):
            transition[i, j] = 0.0
        for j in range(3):
            transition[i, j] = turned[i, j]
        for k in range(p):
            for j in range(3):
                transition[i, 3 + k] -= turned[i, j] * regressor[j, k]
        for k in range(n):
            for j in range(3):
                transition[i, w + 3 * k + j] = scale[k] * (identity[i, j] - turned[i, j])
    lasting = multiply(J_inv, lasting)
    rate = add(rate, lasting)
    if flexible > 0:
        _write_modes(belief, work, rate, turned)
    write_times_regressor(identity, rate, regressor)
    _write_growth(belief, prior, work.theta)
    for i in range(3):
        for k in range(p):
            transition[i, 3 + k] += regressor[i, k] * work.theta[k]
    _write_gain(belief, inertia, lasting, transition)
    propagate(belief, work, 0.0)
    _write_gain(belief, inertia, (0.0, 0.0, 0.0), transition)  # predictions write no columns of G
    _grow(belief, work.theta)
    store(belief.reference_rate, rate)
    store(belief.smoothed_rate, add(load(belief.smoothed_rate), lasting))
    a = calibration.wheel_input(belief, belief.speed)
    store(belief.wheel_input, a)
    total = add(carried, a)
    store(mean, total if flexible == 0 else add(total, modes.momentum(belief)))


@inline
def _is_relative(belief):
    """Whether errors of theta last relative to theta."""
    return belief.calibration.gain > 0 or belief.calibration.wheels > 0


@inline
def _write_growth(belief, prior, growth):
    """What theta's errors grow by (p,), where an update took theta from that of `prior` to that of the mean."""
    p = growth.shape[0]
    for k in range(p):
        growth[k] = 1.0
    if not _is_relative(belief):
        return
    for k in range(3):
        growth[k] = belief.mean[3 + k] / prior[3 + k]
    if p == 6:
        growth[3] = np.sqrt(growth[0] * growth[1])
        growth[4] = np.sqrt(growth[0] * growth[2])
        growth[5] = np.sqrt(growth[1] * growth[2])


@inline
def _grow(belief, growth):
    """Let theta's errors grow, and the adaptation's derivatives with them."""
    if not _is_relative(belief):
        return
    P, t, D = belief.covariance, belief.adaptation.theta_slope, belief.adaptation.covariance_slope
    p = growth.shape[0]
    for k in range(p):
        t[k] *= growth[k]
        for j in range(p):
            D[k, j] *= growth[k] * growth[j]
        for j in range(P.shape[0]):
            P[3 + k, j] = P[j, 3 + k] = P[3 + k, j] * growth[k]
        P[3 + k, 3 + k] *= growth[k]


@inline
def _write_gain(belief, inertia, moved, transition):
    """Columns of G in the transition of M, -J dG dr, for a rate that has moved by dr."""
    g = belief.calibration.gain
    if g == 0:
        return
    x, y, z, xy, xz, yz = inertia
    J = (x, xy, xz), (xy, y, yz), (xz, yz, z)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                transition[i, g + 3 * j + k] = -J[i][j] * moved[k]


@inline
def _write_modes(belief, work, rate, turned):
    """Columns of the modes in the transition of M, whose errors of the rate before are in work.rows; their own rows."""
    transition, before, after = work.transition, work.rows, work.modes.omega
    first, last = belief.modes.first, belief.modes.first + modes.STATES * belief.modes.coupling.shape[0]
    modes.write_rate_errors(belief, belief.mean, rate, after)
    for i in range(3):
        for j in range(first, last):
            total = -after[i, j]
            for k in range(3):
                total += turned[i, k] * before[k, j]
            transition[i, j] = total
    for r in range(3, 3 + 2 * belief.modes.coupling.shape[0]):
        for j in range(transition.shape[1]):
            transition[r, j] = 0.0
        transition[r, modes.moving(belief, r)] = 1.0


@inline
def _write_product(a, b, out):
    """out (3, 3) = A B of symmetric matrices."""
    rows = ((a[0], a[3], a[4]), (a[3], a[1], a[5]), (a[4], a[5], a[2]))
    for i in range(3):
        store(out[i], multiply(b, rows[i]))
