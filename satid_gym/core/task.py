"""Record of the task: what an episode asks for, its timing, envelope and reward, and the normalisation of observations.

It holds the rate loop too, whose reference is an action.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.control.rate_tracking import tracking_dtype
from satid_gym.core.records import FLOAT, INT


@functools.cache
def task_dtype(n: int, oscillators: int = 0) -> np.dtype:
    """Fields for n wheels and `oscillators` oscillators."""
    return np.dtype(
        [
            ("template", INT),  # row of the templates the episode was drawn from
            ("sample_period", FLOAT),
            ("samples", INT),  # filter steps a decision
            ("decisions", INT),  # horizon
            ("decision", INT),  # decisions taken
            ("torque_max", FLOAT, n),
            ("wheel_speed_max", FLOAT, n),
            ("rate_limit", FLOAT),
            ("termination_rate", FLOAT),
            ("deflection_limit", FLOAT, oscillators),
            ("termination_deflection", FLOAT, oscillators),
            ("control_authority", FLOAT, 3),  # rate limits gained a decision at full torque, by prior inertia
            (
                "momentum_fraction",
                FLOAT,
                3,
            ),  # share of the wheels' momentum that one rate limit takes, by prior inertia
            ("criterion", INT),
            ("net", INT),
            ("gain_scale", FLOAT),
            ("held_scale", FLOAT),
            ("held_reference", FLOAT),
            ("envelope_margin", FLOAT),
            ("envelope_weight", FLOAT),
            ("saturation_weight", FLOAT),
            ("deflection_weight", FLOAT),
            ("avoided_band_weight", FLOAT),
            ("effort_weight", FLOAT),
            ("observation", INT),  # an ObservationForm
            ("tells_walk", INT),  # whether the filter's walk of the inertia is observed
            ("tells_sun", INT),  # whether it is observed where the Sun is, relative to the body
            ("tells_earth", INT),  # likewise the Earth
            ("sun", FLOAT, 3),  # direction of the Sun by the ephemeris, inertial frame; 0: not told
            ("orbit_rate", FLOAT),  # rad/s
            ("tells_window", INT),  # whether imaging windows are observed
            ("payload", FLOAT, 3),  # boresight of the payload, unit vector, body frame
            ("opens", FLOAT),  # s, of the window that is open or comes next
            ("closes", FLOAT),
            ("target", FLOAT, 3),  # of that window, unit vector, inertial frame
            ("pointing_cosine", FLOAT),  # of the largest angle to the target in a window
            ("steadiness", FLOAT),  # rad/s, largest body rate in a window
            ("nis_sum", FLOAT),  # of the readings of the decision that the filter has compared with what it expected
            ("nis_count", INT),  # of these readings
            ("command", FLOAT, n),  # previous action, three numbers where the rate loop is on
            ("tracking", tracking_dtype(n)),
            ("over", INT),  # 1 when the episode has ended and has not been reset
        ],
        align=True,
    )
