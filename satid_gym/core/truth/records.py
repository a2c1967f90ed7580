"""Records of the truth: `plant`, one row an environment, and `draw`, the distributions an episode is drawn from."""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.records import FLOAT, INT, UINT, Field
from satid_gym.core.truth.operations import operations_dtype
from satid_gym.core.truth.oscillator_geometry import oscillators_dtype
from satid_gym.core.truth.sampling import sampling_dtype
from satid_gym.core.truth.star_tracker import tracker_dtype


def _wheels(n: int) -> list[Field]:
    return [
        ("axes", FLOAT, (3, n)),  # spin axes, unit columns
        ("wheel_inertia", FLOAT, n),  # spin inertia j
        ("torque_max", FLOAT, n),
        ("wheel_speed_max", FLOAT, n),
    ]


@functools.cache
def plant_dtype(n: int, knots: int = 1, oscillators: int = 0, lines: int = 0, delay: int = 0) -> np.dtype:
    """Truth: wheels, body, environment, sensors, and the random stream that moves them.

    `knots`: room for those of a law given as a table, see `satid_gym.laws.InertiaLaw.room`; 1 for other laws.
    `lines`: room for readings on their way, where sensors are timed.
    `delay`: the longest of a command, in samples; there is room for 16, 64, 256, ... commands, because the core is
    compiled for each room.
    """
    return np.dtype(
        [
            *_wheels(n),
            ("torque_noise_std", FLOAT, n),
            ("torque_lag", FLOAT),  # time constant of the motor, s
            ("rubs", INT),  # 1: the wheels have friction
            ("friction_coulomb", FLOAT),
            ("friction_static", FLOAT),
            ("friction_viscous", FLOAT),
            ("stribeck_speed", FLOAT),
            ("avoided_speed", FLOAT, 2),  # band of |wheel speed| that operators avoid; empty where equal
            # body: J(t) = inertia + f(t) change, f by the law; of a table J(t) = inertia + D(t)
            ("inertia", FLOAT, (3, 3)),
            ("law", INT),
            ("change", FLOAT, (3, 3)),
            ("law_time", FLOAT),  # when step, release or deployment comes; how long drift or fuel take
            ("law_duration", FLOAT),  # of a deployment, s
            ("law_frequency", FLOAT),  # Hz
            ("law_phase", FLOAT),
            ("stepped", INT),  # 1 once the step has come
            ("knots", INT),  # of a table, in use
            ("knot_time", FLOAT, knots),  # s, increasing
            ("knot_change", FLOAT, (knots, 6)),  # D at a knot: xx, yy, zz, xy, xz, yz; linear between
            ("inertia_walk", FLOAT, 3),  # random walk of the moments, kg m^2 per sqrt(s), in studies alone
            ("oscillators", oscillators_dtype(oscillators)),
            # environment
            ("orbit_rate", FLOAT),
            ("gravity_gradient", INT),  # 0: off
            ("solar_force", FLOAT, 3),  # inertial frame
            ("solar_offset", FLOAT, 3),  # centre of pressure from centre of mass
            ("torque_constant", FLOAT, 3),
            ("torque_cosine", FLOAT, 3),  # times cos(orbit_rate t)
            ("torque_sine", FLOAT, 3),
            ("torque_walk", FLOAT),  # random walk of torque_constant, N m per sqrt(s), in studies alone
            # sensors
            ("gyro_noise_std", FLOAT),
            ("gyro_bias_walk", FLOAT),  # rad/s per sqrt(s)
            ("tachometer_noise_std", FLOAT),
            ("gyro_uncalibrated", INT),  # 1: gyro_gain differs from 1
            ("gyro_gain", FLOAT, (3, 3)),  # 1 + G: scale and misalignment
            # state
            ("time", FLOAT),
            ("momentum", FLOAT, 3),  # M, body frame
            ("wheel_momentum", FLOAT, n),  # j (Omega + A^T omega); j Omega where locked at the speed limit
            ("locked", INT, n),
            ("attitude", FLOAT, 4),  # body to inertial, scalar last
            ("motor_torque", FLOAT, n),  # behind the lag
            ("gyro_bias", FLOAT, 3),
            ("stream", UINT, 4),
            # of a step in which wheels rub
            ("wheel_slope", FLOAT, (4, n)),  # dh/dt at its stages
            ("stage_momentum", FLOAT, n),
            ("net_torque", FLOAT, n),  # mean, of motor less friction
            # derived from the state at `time`
            ("rate", FLOAT, 3),
            ("wheel_speed", FLOAT, n),
            # sensor readings at `time`
            ("gyro", FLOAT, 3),
            ("tachometer", FLOAT, n),
            *_faults(n, delay),
            ("sampling", sampling_dtype(n, lines)),
            ("tracker", tracker_dtype()),
            ("operations", operations_dtype()),
        ],
        align=True,
    )


def _room(commands: int) -> int:
    """The least power of 4, from 16 on, that is as much."""
    room = 16
    while room < commands:
        room *= 4
    return room


def _faults(n: int, delay: int) -> list[Field]:
    """What goes wrong in the episode; the rest is void where `faulty` is 0."""
    return [
        ("faulty", INT),
        ("gyro_dropout", FLOAT, 2),  # s, between which the gyro delivers nothing new
        ("gyro_dropout_silent", INT),  # 1: and does not say so
        ("gyro_outlier", FLOAT),  # by sample
        ("gyro_outlier_size", FLOAT, 2),  # rad/s
        ("tachometer_stuck_wheel", INT),
        ("tachometer_stuck", FLOAT, 2),  # s, between which its tachometer repeats itself
        ("wheel_loss_wheel", INT),
        ("wheel_loss_start", FLOAT),  # s
        ("wheel_loss_left", FLOAT),  # part of the motor torque that the weak wheel still gives
        ("torque_delay", INT),  # samples
        ("torque_waiting", FLOAT, (_room(delay + 1), n)),  # commands, that which is obeyed next first
        ("torque_obeyed", FLOAT, n),  # command that the motors follow
        ("gyro_flagged", INT),  # 1: the gyro says that its reading is repeated
        ("spiked", INT),  # 1: the reading is an outlier
    ]


@functools.cache
def draw_dtype(knots: int = 1, oscillators: int = 0) -> np.dtype:
    """How a satellite's episodes depart from its templates, the records of plant, belief and task."""
    return np.dtype(
        [
            ("inertia_std", FLOAT),  # of the log of each axis' scale
            ("tilt_std", FLOAT),  # of the rotation of the principal axes, rad
            ("wheel_speed_range", FLOAT),  # fraction of the limit
            ("rate_std", FLOAT),
            ("disturbance_std", FLOAT),
            ("attitude_random", INT),
            ("law_probability", FLOAT, 4),
            ("law_size", FLOAT, (4, 2)),  # of the change relative to the inertia: low and high, by law
            ("law_time", FLOAT, (4, 2)),
            ("law_frequency", FLOAT, 2),
            ("law_phase", FLOAT, 2),
            ("mass_size", FLOAT, 2),  # m r^2 of a mass whose place is drawn, relative to the mean moment
            ("law_duration", FLOAT, 2),  # s
            ("change_given", INT),  # 1: the change is absolute tensors of the plant's, law_size is not used
            ("knot_size", FLOAT, knots),  # change at the knots of a table relative to the inertia
            # tolerances: std of what gyro and wheels are off nominal by
            ("tolerance_gyro_bias", FLOAT),  # rad/s
            ("tolerance_gyro_scale", FLOAT),
            ("tolerance_gyro_alignment", FLOAT),  # rad
            ("tolerance_wheel_inertia", FLOAT),
            ("tolerance_wheel_alignment", FLOAT),  # rad
            # oscillators: std of the logarithms, and the first of a mirrored pair, whose draws the second shares
            ("oscillator_mass", FLOAT, oscillators),
            ("oscillator_frequency", FLOAT, oscillators),
            ("oscillator_damping", FLOAT, oscillators),
            ("oscillator_twin", INT, oscillators),
            ("oscillator_deflection", FLOAT, oscillators),  # std of the first one
            ("tolerance_tachometer_delay", FLOAT),  # sample periods
            # faults: probabilities, and ranges low and high
            ("faulty", INT),  # 0: none can happen, and nothing is drawn
            ("fault_time", FLOAT, 2),  # s
            ("gyro_dropout", FLOAT),
            ("gyro_dropout_silent", FLOAT),
            ("gyro_dropout_duration", FLOAT, 2),  # s
            ("gyro_bias_std", FLOAT),  # rad/s
            ("tachometer_stuck", FLOAT),
            ("tachometer_stuck_duration", FLOAT, 2),  # s
            ("wheel_loss", FLOAT),
            ("wheel_loss_size", FLOAT, 2),
            ("torque_delay", INT, 2),  # samples
        ],
        align=True,
    )
