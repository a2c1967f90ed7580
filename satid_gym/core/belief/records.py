"""Records of the belief: `belief`, one row an environment, and `work`, the scratch space of one thread."""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.belief.adaptation import adaptation_dtype, adaptation_work_dtype
from satid_gym.core.belief.alignment import alignment_dtype
from satid_gym.core.belief.attitude import attitude_dtype
from satid_gym.core.belief.calibration import calibration_dtype
from satid_gym.core.belief.gating import gate_dtype
from satid_gym.core.belief.modes import modes_dtype, modes_work_dtype
from satid_gym.core.belief.whiteness import whiteness_dtype
from satid_gym.core.records import FLOAT, INT


@functools.cache
def belief_dtype(
    n: int, p: int, size: int, errors: int = 0, modes: int = 0, trackers: int = 0, lines: int = 0
) -> np.dtype:
    """Belief: what the filter was told before launch, and its state.

    mean is [M, theta, disturbance torque, 5 states of each of so many `modes`, attitude error where there is one of
    `trackers`, `errors` of sensors and wheels] for MOMENTUM, [omega, theta, wheel speed] for RATE. `lines`: room for
    readings that are aligned.
    """
    return np.dtype(
        [
            ("kind", INT),
            ("axes", FLOAT, (3, n)),
            ("wheel_inertia", FLOAT, n),
            ("gyro_std", FLOAT),
            ("tachometer_std", FLOAT),
            ("wheel_momentum_covariance", FLOAT, (3, 3)),  # of A j Omega, from the tachometers
            ("walk", FLOAT, size),  # process noise: random walk of each state, per sqrt(s)
            ("substeps", INT),
            ("prior_theta", FLOAT, p),
            ("prior_theta_std", FLOAT, p),
            ("theta_scale", FLOAT, p),  # prior moments; geometric means of two of them for the products
            ("scale_variance", FLOAT),  # of a common factor on theta that no excitation finds
            ("prior_torque_std", FLOAT),
            ("prior_std", FLOAT, 2),  # RATE: of omega and of wheel speed
            ("mean", FLOAT, size),
            ("covariance", FLOAT, (size, size)),
            ("wheel_input", FLOAT, max(3, n)),  # last A j Omega (3) for MOMENTUM, last Omega (n) for RATE
            ("constrained_updates", INT),  # updates shortened because the inertia would have left its physical range
            ("broken", INT),  # 1 once the covariance was not positive definite
            ("coasting", INT),  # 1: the filter has accepted no gyro reading of this instant and only propagates
            ("speed", FLOAT, n),  # wheel speeds that the filter uses
            ("rate_coordinates", INT),  # 1: updates are made in errors of the rate, see `retraction`
            ("reference_rate", FLOAT, 3),  # of these updates
            ("smoothed_rate", FLOAT, 3),  # running mean of the most likely rate
            ("smoothed_count", INT, 3),  # readings in it
            ("has_moved", INT, 3),  # 1: the axis has turned beyond the noise of the tachometers
            ("stepped", INT),  # 1: since a step of the inertia was found theta is known coarsely
            ("is_told", INT),  # 1: of a deployment or release when it is commanded, see `announcement`
            ("announced", FLOAT),  # share of the change that comes in this sample
            ("leaves", INT),  # 1: what changes leaves with its momentum
            ("stuck", INT, n),  # 1: the tachometer repeats itself; 2: did so until this reading
            ("rejected", INT),  # readings rejected, repeated ones among them
            ("gate", gate_dtype(n)),
            ("adaptation", adaptation_dtype(p)),
            ("modes", modes_dtype(modes)),
            ("calibration", calibration_dtype(n, errors)),
            ("alignment", alignment_dtype(n, lines)),
            ("attitude", attitude_dtype(trackers, lines)),
            ("whiteness", whiteness_dtype()),
        ],
        align=True,
    )


@functools.cache
def work_dtype(n: int, p: int, size: int, modes: int = 0) -> np.dtype:
    """Scratch space of one thread."""
    wide = max(size, 3)
    return np.dtype(
        [
            ("torque", FLOAT, n),  # commanded for the decision under way
            ("transition", FLOAT, (wide, wide)),
            ("product", FLOAT, (wide, wide)),
            ("prior_mean", FLOAT, wide),  # before an update that is iterated
            ("prior_covariance", FLOAT, (wide, wide)),
            ("regressor", FLOAT, (3, p)),
            ("rows", FLOAT, (3 + n, wide)),
            ("jacobian", FLOAT, (4, 3, 3)),
            ("sensitivity", FLOAT, (2, 3, p)),
            ("ph", FLOAT, wide),
            ("remainder", FLOAT, wide),
            ("gain", FLOAT, wide),
            ("delta", FLOAT, wide),
            ("theta", FLOAT, p),
            ("innovation", FLOAT, 3 + n),
            ("normalised", FLOAT, 3 + n),  # innovation, each scalar given those before it
            ("innovation_variance", FLOAT, 3 + n),  # of each, over that of its noise
            ("block", FLOAT, (p, p)),
            ("theta_covariance", FLOAT, (p, p)),
            ("adaptation", adaptation_work_dtype(p)),
            ("attitude", FLOAT, (3, wide)),
            ("wheel", FLOAT, n),
            ("modes", modes_work_dtype(modes, size)),
        ],
        align=True,
    )
