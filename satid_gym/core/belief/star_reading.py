"""Star reading: what a reading of the star tracker tells of the attitude.

Where readings of gyro and wheels are aligned in time (`alignment`) the state, and q with it, is a weighted mean of what
is true at the ends of the sample periods, i periods ago with weight c_i: those of the gyro's reading, convolved with
those of the tachometers'. So a reading waits for m samples, which is about the state's age, n = sum_i c_i i, and is
compared then. From the state to the end m periods ago the body turns by

    phi = (n - m) omega dt + J^-1 sum_k v_k p_k dt
        + ((n - m)^2 - sum_i c_i (i - m)^2 / 2) dt^2 J^-1 (M x omega + tau + F)
    v_k = sum_(i > k) c_i (i - k - 1/2 - n + m) for k >= m,  sum_(i <= k) c_i (k - i + 1/2 + n - m) for k < m

with F the torque of the modes' springs and dampers, and p_k = A u_k dt what the motors were commanded to in the sample
that ended k periods ago. The motors' noise is left out: v_k is small, whereas at once (m = 0) that noise would exceed a
good tracker's (docs/startracker.md). With r the rate at which derivatives are taken and d the tachometers' delay, which
is a part of n,

    q_read (q exp(phi))^-1 = exp(psi + R dphi + noise)
    dphi = (n - m) dt J^-1 (dM - L(r) dtheta - sum_k Omega_k de_k) + r dt dd

Errors of tau, F and the commands are left out. Those of an encoder add up to an error of the angle that is no larger
than that of a count: it is taken as noise of the reading. Source: this project's design.
"""

from __future__ import annotations

from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    congruence,
    cross,
    load,
    load_symmetric,
    multiply,
    store,
    subtract,
)
from satid_gym.core.belief import attitude, modes, momentum_model
from satid_gym.core.belief.kalman import add_symmetric
from satid_gym.core.jit import inline, outline
from satid_gym.core.rotation import (
    load_quaternion,
    product,
    rotation_vector,
    store_quaternion,
    symmetric_to_inertial,
    to_inertial,
    turn,
)
from satid_gym.core.sampling import LINE

_ENCODER_SHARE = 0.5  # of a count's variance, at most, that is left of it in the angle: 0.375 with an integrating gyro


@outline
def _turned(belief, J_inv, m):
    """phi (3,) from the state to the end m periods ago, and n - m in seconds."""
    a, period = belief.alignment, belief.attitude.period
    ends = a.end_weight.shape[0]
    for i in range(ends):
        a.end_weight[i] = 0.0
    for i in range(LINE):
        for j in range(LINE):
            a.end_weight[i + j] += a.gyro_end_weight[i] * a.gyro_weight[j]
    late, square = 0.0, 0.0
    for i in range(ends):
        late += a.end_weight[i] * (i - m)
        square += a.end_weight[i] * (i - m) * (i - m)
    swept = (0.0, 0.0, 0.0)
    for k in range(ends):
        v = 0.0
        for i in range(ends):
            if k >= m and i > k:
                v += a.end_weight[i] * (i - k - 0.5 - late)
            elif k < m and i <= k:
                v += a.end_weight[i] * (k - i + 0.5 + late)
        swept = axpy(v * period, load(a.push_line[k]), swept)
    momentum, tau = load(belief.mean), load(belief.mean[3 + belief.prior_theta.shape[0] :])
    omega = multiply(J_inv, momentum_model.body_momentum(belief))
    push = add(add(cross(momentum, omega), tau), modes.spring_torque(belief, omega))
    change = axpy((late * late - 0.5 * square) * period * period, push, swept)
    return axpy(late * period, omega, multiply(J_inv, change)), late * period


@outline
def present(belief):
    """Attitude at present, a quaternion; of a state that is as old as its readings that of the state."""
    q = load_quaternion(belief.attitude.quaternion)
    if belief.alignment.gyro_line.shape[0] == 0:
        return q
    return product(q, turn(_turned(belief, momentum_model.inverse_inertia(belief), 0)[0]))


@inline
def await_state(belief, reading):
    """Whether a reading (4,) that comes now is to wait, and let it."""
    state = belief.attitude
    if state.wait == 0:
        return False
    state.waits[0] = 1
    for i in range(4):
        state.line[0, i] = reading[i]
    return True


@outline
def wait_on(belief):
    """Let a sample pass for the readings that wait."""
    state = belief.attitude
    for k in range(state.wait, 0, -1):
        state.waits[k] = state.waits[k - 1]
        for i in range(4):
            state.line[k, i] = state.line[k - 1, i]
    if state.wait > 0:
        state.waits[0] = 0


@inline
def _noise(state, q):
    """N (symmetric) at an attitude, rad^2."""
    x, y, z = to_inertial(q, load(state.boresight[0]))
    s, d = state.across_variance, state.round_variance - state.across_variance
    return s + d * x * x, s + d * y * y, s + d * z * z, d * x * y, d * x * z, d * y * z


@outline
def _write_rows(belief, work, J_inv, phi, s, rows):
    """R dphi by the state, to rows (3, size)."""
    c, state = belief.calibration, belief.attitude
    q = load_quaternion(state.quaternion)
    own = multiply(J_inv, momentum_model.body_momentum(belief))
    rate = own
    if s != 0.0:
        rate = axpy(1.0 / s, phi, subtract(load(belief.reference_rate), own))
    momentum_model.write_rate_rows(belief, work, J_inv, rate, rows)
    for k in range(c.spin_count):
        for i in range(3):
            for j in range(3):
                rows[i, c.spins + 3 * k + j] = -c.spin_scale[k] * work.jacobian[0, i, j]
    for j in range(rows.shape[1]):
        column = to_inertial(q, (s * rows[0, j], s * rows[1, j], s * rows[2, j]))
        rows[0, j], rows[1, j], rows[2, j] = column
    if c.delay > 0:
        column = to_inertial(q, axpy(state.period, load(belief.reference_rate), (0.0, 0.0, 0.0)))
        rows[0, c.delay], rows[1, c.delay], rows[2, c.delay] = column


@inline
def _angle_noise(belief, J_inv):
    """Covariance (symmetric) of what an encoder's errors add up to in the angle, inertial frame, over the period^2."""
    noise = congruence(J_inv, load_symmetric(belief.alignment.noise_covariance))
    return symmetric_to_inertial(belief.attitude.quaternion, noise)


@outline
def begin(belief, work, reading):
    """Take a reading (4,) for the attitude, whose error has nothing to do with what was known before."""
    attitude.forget(belief)
    state = belief.attitude
    state.known, state.age, state.rejections = 1, state.wait * state.period, 0
    store_quaternion(state.quaternion, load_quaternion(reading))
    add_symmetric(1.0, _noise(state, state.quaternion), belief.covariance, state.first)
    if belief.alignment.gyro_line.shape[0] > 0:
        _turn_back(belief, work)


@outline
def _turn_back(belief, work):
    """Take the attitude, as it was read, to the instant that the state stands for: psi is less R dphi then."""
    state, rows, J_inv = belief.attitude, work.attitude, momentum_model.inverse_inertia(belief)
    phi, s = _turned(belief, J_inv, state.wait)
    store_quaternion(state.quaternion, product(load_quaternion(state.quaternion), turn((-phi[0], -phi[1], -phi[2]))))
    if belief.alignment.noise_taps > 0:
        share = _ENCODER_SHARE * state.period**2
        add_symmetric(share, _angle_noise(belief, J_inv), belief.covariance, state.first)
    _write_rows(belief, work, J_inv, phi, s, rows)
    for i in range(3):
        for j in range(rows.shape[1]):
            rows[i, j] = -rows[i, j]
    attitude.propagate(belief, work)


@outline
def linearise(belief, work, reading):
    """Whitened rows and innovation of a reading (4,), to work."""
    state, rows, size = belief.attitude, work.rows, belief.mean.shape[0]
    q = load_quaternion(state.quaternion)
    noise = _noise(state, state.quaternion)
    for i in range(3):
        for j in range(size):
            rows[i, j] = 0.0
    if belief.alignment.gyro_line.shape[0] > 0:
        J_inv = momentum_model.inverse_inertia(belief)
        phi, s = _turned(belief, J_inv, state.wait)
        q = product(q, turn(phi))
        _write_rows(belief, work, J_inv, phi, s, rows)
        if belief.alignment.noise_taps > 0:
            noise = axpy_symmetric(_ENCODER_SHARE * state.period**2, _angle_noise(belief, J_inv), noise)
    for i in range(3):
        rows[i, state.first + i] = 1.0
    x, y, z, w = q
    store(work.innovation, rotation_vector(product(load_quaternion(reading), (-x, -y, -z, w))))
    momentum_model.whiten(work, noise)
