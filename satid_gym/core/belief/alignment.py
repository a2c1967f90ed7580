"""Alignment: readings of gyro and wheels brought to the same instants, for a filter that takes them as simultaneous.

Between two samples' ends wheel speed and body rate run straight, so each reading is a weighted mean of their values
there (`core.sampling`): weights g for the gyro's, w for the tachometers'. The gyro's readings z averaged with w, and
the wheel speeds Omega averaged with g, are then the same mean of both, whatever g and w are:

    z' = sum_i w_i z_(k-i),   Omega' = sum_i g_i Omega_(k-i),   z' = J^-1 (M - A j Omega') + noise

Neighbouring means share readings, so their noise is correlated; as the weights' sum is 1 it has in the long run, where
the inertia is learned, the variance of a reading, and is taken as white with that. What is unknown of the tachometers'
delay, d, is a state: w follows its estimate, and dz'/dd is the change of the rate over a sample, J^-1 A u dt as the
motors were commanded (readings are noisy), and without commands J^-1 (a - a_before), where that is beyond its noise.

An encoder's wheel angle is known to a pulse at each sample's end; the wheel speed is the difference of two, so its
error is blue: in the long run it is nothing, and white noise, quantum^2 / (6 dt^2), would be far too much. So the
angles' errors v, independent from sample to sample, are states, three of A j v for each reading of Omega':

    a = A j Omega' - sum_b c_b (A j v_(k-b)) / dt,   c = g * (1, -1)

Source: this project's design; for states that whiten correlated noise, Bar-Shalom, Li, Kirubarajan, Estimation with
Applications to Tracking and Navigation (2001), ch. 8.2; for the variance, `estimators.prior.counting_std`.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.algebra import axpy, axpy_symmetric, dot, inverse, load, load_symmetric, multiply, store, subtract
from satid_gym.core.belief.kalman import estimated_inertia
from satid_gym.core.belief.modes import body_inertia
from satid_gym.core.belief.retraction import EXCITATION_SIGMAS
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT
from satid_gym.core.sampling import LINE, write_weights
from satid_gym.core.wheels import sum_wheels


@functools.cache
def alignment_dtype(n: int, lines: int) -> np.dtype:
    """Alignment: data sheet, weights and the readings that they weigh; 0 lines where all are of the present."""
    return np.dtype(
        [
            ("gyro_delay", FLOAT),  # sample periods, less what both sensors have in common
            ("gyro_averaged", INT),  # 1: over the sample period
            ("tachometer_delay", FLOAT),
            ("tachometer_averaged", INT),
            ("age", FLOAT),  # sample periods from the instant that the gyro's reading stands for to the present
            ("state_age", FLOAT),  # the same from the instant that the aligned readings, and so the state, stand for
            ("noise_taps", INT),  # of the angles' errors, 3 states each; 0: no encoder
            ("noise", INT),  # index of the first in the mean
            ("noise_covariance", FLOAT, (3, 3)),  # of A j v / dt
            ("gyro_weight", FLOAT, lines),  # w
            ("wheel_weight", FLOAT, lines),  # g
            ("gyro_line", FLOAT, (lines, 3)),  # readings, the latest first
            ("gyro_valid", INT, lines),
            ("wheel_line", FLOAT, (lines, n)),
            ("span", INT),  # sample periods that an aligned reading is a mean of, in part
            ("mixed", INT),  # readings from the last on that are means of values before and after a step of the inertia
            ("push_line", FLOAT, (2 * lines, 3)),  # A u dt of the motors' commands, the latest first
            ("gyro_end_weight", FLOAT, lines),  # of the gyro's reading, with what both sensors have in common
            ("end_weight", FLOAT, 2 * lines),  # of the state, see `star_reading`
            ("input_change", FLOAT, 3),  # of a over the last prediction
        ],
        align=True,
    )


@outline
def start(belief, gyro, tachometer):
    """Take the first readings for all before them too, but with a gate that of the gyro, which may be an outlier."""
    s = belief.alignment
    if s.gyro_line.shape[0] == 0:
        return
    write_weights(s.tachometer_delay, s.tachometer_averaged, s.gyro_weight)
    write_weights(s.gyro_delay, s.gyro_averaged, s.wheel_weight)
    c = belief.calibration
    for b in range(s.noise_taps):
        weight = s.wheel_weight[b] - (s.wheel_weight[b - 1] if b > 0 else 0.0)
        c.spin_scale[c.spin_count - s.noise_taps + b] = -weight
    for line in range(2 * LINE):
        store(s.push_line[line], (0.0, 0.0, 0.0))
    for line in range(LINE):
        store(s.gyro_line[line], load(gyro))
        s.gyro_valid[line] = 1 if line == 0 or belief.gate.threshold == 0.0 else 0
        for k in range(tachometer.shape[0]):
            s.wheel_line[line, k] = tachometer[k]
    s.mixed = 0


@inline
def first_input_covariance(belief):
    """Covariance of the first a: where readings are counts, of a single one, that stands for all before it."""
    if belief.alignment.noise_taps == 0:
        return load_symmetric(belief.wheel_momentum_covariance)
    return axpy_symmetric(2.0, load_symmetric(belief.alignment.noise_covariance), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@inline
def take_wheels(belief, tachometer, torque, dt):
    """Write to belief.speed the wheel speeds (n,) of a new reading, aligned; `torque` (n,) is the motors' command."""
    if belief.alignment.gyro_line.shape[0] > 0:
        _align_wheels(belief, tachometer, torque, dt)
        return
    for k in range(tachometer.shape[0]):
        belief.speed[k] = tachometer[k]


@outline
def _align_wheels(belief, tachometer, torque, dt):
    s = belief.alignment
    for k in range(tachometer.shape[0]):
        for line in range(LINE - 1, 0, -1):
            s.wheel_line[line, k] = s.wheel_line[line - 1, k]
        s.wheel_line[0, k] = tachometer[k]
        total = 0.0
        for line in range(LINE):
            total += s.wheel_weight[line] * s.wheel_line[line, k]
        belief.speed[k] = total
    for line in range(2 * LINE - 1, 0, -1):
        store(s.push_line[line], load(s.push_line[line - 1]))
    store(s.push_line[0], axpy(dt, sum_wheels(belief.axes, torque), (0.0, 0.0, 0.0)))
    if s.noise_taps > 0:
        _shift_noise(belief)


@inline
def leave_out_mixed(belief):
    """Leave out the readings that mix values before and after a step of the inertia; whether there are any.

    They are as many as a reading's mean spans samples. What an encoder's errors have taken up of the step is forgotten.
    """
    s = belief.alignment
    s.mixed = s.span
    for _ in range(s.noise_taps):
        _shift_noise(belief)
    return s.span > 0


@outline
def _shift_noise(belief):
    """Let the angles' errors be those of one sample earlier, and the first an unknown one."""
    s, covariance, mean = belief.alignment, belief.covariance, belief.mean
    first, size = s.noise, belief.mean.shape[0]
    for i in range(first + 3 * s.noise_taps - 1, first + 2, -1):
        mean[i] = mean[i - 3]
        for j in range(size):
            covariance[i, j] = covariance[i - 3, j]
        for j in range(size):
            covariance[j, i] = covariance[j, i - 3]
    for i in range(3):
        mean[first + i] = 0.0
        for j in range(size):
            covariance[first + i, j] = covariance[j, first + i] = 0.0
    for i in range(3):
        for j in range(3):
            covariance[first + i, first + j] = s.noise_covariance[i, j]


@inline
def take_gyro(belief, gyro, valid):
    """Take in a reading (3,), valid: 1; whether all that have a weight are valid, and of one inertia."""
    return valid != 0 if belief.alignment.gyro_line.shape[0] == 0 else _align_gyro(belief, gyro, valid)


@outline
def _align_gyro(belief, gyro, valid):
    s = belief.alignment
    for line in range(LINE - 1, 0, -1):
        store(s.gyro_line[line], load(s.gyro_line[line - 1]))
        s.gyro_valid[line] = s.gyro_valid[line - 1]
    store(s.gyro_line[0], load(gyro))
    s.gyro_valid[0] = valid
    s.mixed = max(s.mixed - 1, 0)
    complete = s.mixed == 0
    for line in range(LINE):
        complete = complete and (s.gyro_weight[line] == 0.0 or s.gyro_valid[line] != 0)
    return complete


@inline
def aligned_gyro(belief, gyro):
    """Reading z' (3,), rad/s, of the instant that the aligned wheel speeds stand for."""
    s = belief.alignment
    if s.gyro_line.shape[0] == 0:
        return load(gyro)
    d = belief.calibration.delay
    if d > 0:
        write_weights(s.tachometer_delay + belief.mean[d], s.tachometer_averaged, s.gyro_weight)
    z = (0.0, 0.0, 0.0)
    for line in range(LINE):
        z = axpy(s.gyro_weight[line], load(s.gyro_line[line]), z)
    return z


@outline
def write_delay_rows(belief, J_inv, spin, rows):
    """Derivative of the innovation by the tachometers' delay, -dz'/dd, to rows (3, size).

    `spin` is the variance of a wheel speed's noise as a rate.
    """
    s, d = belief.alignment, belief.calibration.delay
    change, beyond = load(s.input_change), EXCITATION_SIGMAS**2 * 2.0
    commanded = _commanded_change(belief)
    if dot(commanded, commanded) > 0.0:
        change, beyond = commanded, 0.0
    change = multiply(J_inv, change)
    for i in range(3):
        rows[i, d] = -change[i] if change[i] * change[i] > beyond * spin[i] else 0.0


@inline
def _commanded_change(belief):
    """Change of a over the sample that dz'/dd is the rate's change of, by the motors' commands, N m s.

    With the tachometers' weights w of an instant dw/dd is (-1, 1) at n, of a period (-(1 - f), 1 - 2 f, f) at n.
    """
    s = belief.alignment
    late = min(max(s.tachometer_delay + belief.mean[belief.calibration.delay], 0.0), LINE - 3.0)
    n = np.int64(late)
    f = late - n if s.tachometer_averaged != 0 else 0.0
    change = (0.0, 0.0, 0.0)
    for j in range(LINE - n - 1):
        change = axpy(s.wheel_weight[j] * (1.0 - f), load(s.push_line[n + j]), change)
        change = axpy(s.wheel_weight[j] * f, load(s.push_line[n + j + 1]), change)
    return change


@outline
def _push(belief, age):
    """What the motors were commanded to do to a, N m s, in the last `age` sample periods."""
    s = belief.alignment
    total = (0.0, 0.0, 0.0)
    for line in range(LINE):
        total = axpy(min(max(age - line, 0.0), 1.0), load(s.push_line[line]), total)
    return total


@inline
def present_rate(belief, rate, age):
    """Rate at present, rad/s, of one that is so many sample periods old: meanwhile the motors have turned the body.

    Of that the command is known: the change is -J^-1 A u dt, summed up over the age, J that of the body without modes.
    """
    if belief.alignment.gyro_line.shape[0] == 0:
        return rate
    inertia = body_inertia(belief, belief.mean, estimated_inertia(belief))
    return subtract(rate, multiply(inverse(inertia), _push(belief, age)))
