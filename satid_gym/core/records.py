"""The records the core works on: one row an environment, plain numbers, no pointers.

Truth (`plant`) and belief (`belief`) are different records, so a function that is handed the belief cannot
see the true inertia. `task` holds what the episode asks for, `report` what the last decision gave, `draw`
the distributions an episode is drawn from, `work` scratch space (one a thread).
n: wheels; p: inertia parameters (3 principal moments, or 6 with the products xy, xz, yz); size: filter state.
All in SI units and the body frame unless said otherwise.

There is one dtype object of each kind and size: numba knows one that it has seen by identity, and in every call
compares at length one that is only equal. numpy gives what it joins a new one, so what is joined is viewed as the old.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import DTypeLike

STATIC, STEP, DRIFT, PERIODIC, TABLE = range(5)  # a table is never drawn
MOMENTUM, RATE = range(2)
LOGDET, TRACE, MAXEIG = range(3)
FAULTS = ("gyro_dropout", "gyro_outlier", "tachometer_stuck", "wheel_loss", "torque_delay")

_F, _I, _U = np.float64, np.int64, np.uint64
Field = tuple[str, DTypeLike] | tuple[str, DTypeLike, int | tuple[int, ...]]


def _wheels(n: int) -> list[Field]:
    return [
        ("axes", _F, (3, n)),  # spin axes, unit columns
        ("wheel_inertia", _F, n),  # spin inertia j
        ("torque_max", _F, n),
        ("wheel_speed_max", _F, n),
    ]


@functools.cache
def plant_dtype(n: int, knots: int = 1) -> np.dtype:
    """Truth: wheels, body, environment, sensors, and the random stream that moves them.

    `knots`: room for those of a law given as a table, see `satid_gym.laws.room`; 1 where there is none.
    """
    return np.dtype(
        [
            *_wheels(n),
            ("torque_noise_std", _F, n),
            ("torque_lag", _F),  # time constant of the motor, s
            # body: J(t) = inertia + f(t) change, f by the law; of a table J(t) = inertia + D(t)
            ("inertia", _F, (3, 3)),
            ("law", _I),
            ("change", _F, (3, 3)),
            ("law_time", _F),  # when the step comes; how long the drift takes
            ("law_frequency", _F),  # Hz
            ("law_phase", _F),
            ("stepped", _I),  # 1 once the step has come
            ("knots", _I),  # of a table, in use
            ("knot_time", _F, knots),  # s, increasing
            ("knot_change", _F, (knots, 6)),  # D at a knot: xx, yy, zz, xy, xz, yz; linear between
            # environment
            ("orbit_rate", _F),
            ("gravity_gradient", _I),  # 0: off
            ("solar_force", _F, 3),  # inertial frame
            ("solar_offset", _F, 3),  # centre of pressure from centre of mass
            ("torque_constant", _F, 3),
            ("torque_cosine", _F, 3),  # times cos(orbit_rate t)
            ("torque_sine", _F, 3),
            # sensors
            ("gyro_noise_std", _F),
            ("gyro_bias_walk", _F),  # rad/s per sqrt(s)
            ("tachometer_noise_std", _F),
            # state
            ("time", _F),
            ("momentum", _F, 3),  # M, body frame
            ("wheel_momentum", _F, n),  # j (Omega + A^T omega); j Omega where locked at the speed limit
            ("locked", _I, n),
            ("attitude", _F, 4),  # body to inertial, scalar last
            ("motor_torque", _F, n),  # behind the lag
            ("gyro_bias", _F, 3),
            ("stream", _U, 4),
            # derived from the state at `time`
            ("rate", _F, 3),
            ("wheel_speed", _F, n),
            # sensor readings at `time`
            ("gyro", _F, 3),
            ("tachometer", _F, n),
            *_faults(n),
        ],
        align=True,
    )


def _faults(n: int) -> list[Field]:
    """What goes wrong in the episode; the rest is void where `faulty` is 0."""
    return [
        ("faulty", _I),
        ("dropout", _F, 2),  # s, between which the gyro delivers nothing new
        ("dropout_silent", _I),  # 1: and does not say so
        ("outlier_probability", _F),  # by sample
        ("outlier_size", _F, 2),  # rad/s
        ("stuck_wheel", _I),
        ("stuck", _F, 2),  # s, between which its tachometer repeats itself
        ("weak_wheel", _I),
        ("weak_start", _F),  # s
        ("torque_left", _F),  # part of the motor torque that the weak wheel still gives
        ("torque_delay", _I),  # samples
        ("delay_left", _I),  # samples until torque_waiting is obeyed
        ("torque_waiting", _F, n),  # last command
        ("torque_obeyed", _F, n),  # command that the motors follow
        ("gyro_flagged", _I),  # 1: the gyro says that its reading is no new one
        ("spiked", _I),  # 1: the reading is an outlier
    ]


@functools.cache
def belief_dtype(n: int, p: int, size: int) -> np.dtype:
    """Belief: what the filter was told before launch, and its state.

    mean is [M, theta, disturbance torque] for MOMENTUM, [omega, theta, wheel speed] for RATE.
    """
    return np.dtype(
        [
            ("kind", _I),
            ("axes", _F, (3, n)),
            ("wheel_inertia", _F, n),
            ("gyro_std", _F),
            ("tachometer_std", _F),
            ("wheel_momentum_covariance", _F, (3, 3)),  # of A j Omega, from the tachometers
            ("walk", _F, size),  # random walk of each state, per sqrt(s)
            ("substeps", _I),
            ("prior_theta", _F, p),
            ("prior_theta_std", _F, p),
            ("theta_scale", _F, p),  # prior moments; geometric means of two of them for the products
            ("prior_torque_std", _F),
            ("prior_std", _F, 2),  # RATE: of omega and of wheel speed
            ("mean", _F, size),
            ("covariance", _F, (size, size)),
            ("wheel_input", _F, max(3, n)),  # last A j Omega (3) for MOMENTUM, last Omega (n) for RATE
            ("guarded", _I),  # updates shortened because the inertia would have left its physical range
            ("broken", _I),  # 1 once the covariance was not positive definite
            ("coasting", _I),  # 1: the filter has accepted no gyro reading of this instant
            # which readings are believed, see core.vetting; gate 0: all
            ("gate", _F),  # normalised innovation squared beyond which a reading is rejected
            ("gyro_noisy", _I),  # 0: the gyro is said to have no noise
            ("rejections", _I),  # in a row
            ("since_rejection", _I),  # samples since the first of them; void where there is none
            ("confirmed", _I),  # 1: a reading has agreed with the one that M was started with
            ("rejected", _I),  # readings rejected, or found to be no new ones
            ("last_gyro", _F, 3),
            ("last_speed", _F, n),  # of the tachometers
            ("speed", _F, n),  # that the filter goes by
            ("stuck", _I, n),  # 1: the tachometer repeats itself; 2: did so until this reading
            ("outage", _I),  # samples for which neither the gyro nor a stuck tachometer had anything to say
            ("torque_max", _F, n),
            # how fast theta walks, where that is found out, see core.walk; void where `adaptive` is 0
            ("adaptive", _I),
            ("first_walk", _F),  # per sqrt(s)
            ("least_walk", _F),  # below it the variance is estimated, not its logarithm
            ("most_walk", _F),  # the fastest
            ("walk_drift", _F),  # variance that its parameter gains a second
            ("walk_parameter", _F),
            ("most_walk_parameter", _F),
            ("walk_parameter_variance", _F),
            ("theta_slope", _F, p),  # derivative of theta by the parameter
            ("covariance_slope", _F, (p, p)),  # of its covariance
            ("steps", _I),  # of the inertia that were found
            ("since_step", _F),  # s
        ],
        align=True,
    )


@functools.cache
def task_dtype(n: int) -> np.dtype:
    """What the episode asks for: timing, envelope, reward, normalisation of the observation."""
    return np.dtype(
        [
            ("template", _I),  # row of the templates the episode was drawn from
            ("sample_period", _F),
            ("samples", _I),  # filter steps a decision
            ("decisions", _I),  # horizon
            ("decision", _I),  # decisions taken
            ("torque_max", _F, n),
            ("wheel_speed_max", _F, n),
            ("rate_limit", _F),
            ("termination_rate", _F),
            ("authority", _F, 3),  # rate limits gained a decision at full torque, by prior inertia
            ("swing", _F, 3),  # share of the wheels' momentum that one rate limit takes, by prior inertia
            ("criterion", _I),
            ("net", _I),
            ("gain_scale", _F),
            ("held_scale", _F),
            ("held_reference", _F),
            ("envelope_margin", _F),
            ("envelope_weight", _F),
            ("saturation_weight", _F),
            ("effort_weight", _F),
            ("command", _F, n),  # previous action
            ("over", _I),  # 1 when the episode has ended and has not been reset
        ],
        align=True,
    )


@functools.cache
def report_dtype(n: int) -> np.dtype:
    """What the last decision gave; the source of reward and info."""
    return np.dtype(
        [
            ("reward", _F),
            ("terminated", _I),
            ("truncated", _I),
            ("time", _F),
            ("inertia_true", _F, (3, 3)),
            ("inertia_estimate", _F, (3, 3)),
            ("relative_error", _F),
            ("nees", _F),
            ("nis", _F),
            ("information_gain", _F),
            ("information_held", _F),
            ("outside", _F),
            ("cost", _F),
            ("effort", _F),
            ("saturated", np.int8, n),  # 1: at its speed limit in the decision
            ("torque_applied", _F, n),
            ("guarded", _I),
            ("rejected", _I),
            ("faults", np.int8, len(FAULTS)),  # 1: acted in the decision
            # tallies of the decision under way
            ("peak_rate", _F, 3),  # largest |rate| that the filter goes by
            ("spin_start", _F, n),
        ],
        align=True,
    )


@functools.cache
def draw_dtype(knots: int = 1) -> np.dtype:
    """How a satellite's episodes depart from its templates, the records of plant, belief and task."""
    return np.dtype(
        [
            ("inertia_std", _F),  # of the log of each axis' scale
            ("tilt_std", _F),  # of the rotation of the principal axes, rad
            ("wheel_speed_range", _F),  # fraction of the limit
            ("rate_std", _F),
            ("disturbance_std", _F),
            ("attitude_random", _I),
            ("law_probability", _F, 4),
            ("law_size", _F, (4, 2)),  # of the change relative to the inertia: low and high, by law
            ("law_time", _F, (4, 2)),
            ("law_frequency", _F, 2),
            ("law_phase", _F, 2),
            ("change_given", _I),  # 1: the change is absolute tensors of the plant's, law_size is not used
            ("knot_size", _F, knots),  # change at the knots of a table relative to the inertia
            # faults: probabilities, and ranges low and high
            ("faulty", _I),  # 0: none can happen, and nothing is drawn
            ("fault_time", _F, 2),  # s
            ("dropout_probability", _F),
            ("dropout_silent", _F),
            ("dropout_duration", _F, 2),  # s
            ("bias_std", _F),  # rad/s
            ("stuck_probability", _F),
            ("stuck_duration", _F, 2),  # s
            ("loss_probability", _F),
            ("loss_size", _F, 2),
            ("torque_delay", _I, 2),  # samples
        ],
        align=True,
    )


@functools.cache
def work_dtype(n: int, p: int, size: int) -> np.dtype:
    """Scratch space of one thread."""
    wide = max(size, 3)
    return np.dtype(
        [
            ("torque", _F, n),  # commanded for the decision under way
            ("transition", _F, (wide, wide)),
            ("product", _F, (wide, wide)),
            ("prior_mean", _F, wide),
            ("prior_covariance", _F, (wide, wide)),
            ("regressor", _F, (3, p)),
            ("rows", _F, (3 + n, wide)),
            ("jacobian", _F, (4, 3, 3)),
            ("sensitivity", _F, (3, 3, p)),
            ("ph", _F, wide),
            ("remainder", _F, wide),
            ("gain", _F, wide),
            ("delta", _F, wide),
            ("theta", _F, p),
            ("innovation", _F, 3 + n),
            ("block", _F, (p, p)),
            ("taken", _F, (p, p)),
            ("inverse", _F, (p, p)),
            ("lost", _F, (p, p)),
            ("told", _F, (p, p)),
            ("solved", _F, p),
            ("wheel", _F, (4, n)),
        ],
        align=True,
    )
