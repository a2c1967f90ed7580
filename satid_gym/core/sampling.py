"""Sampling: what a reading that is averaged over the sample period, or late, is of the values at the samples' ends.

Motors change their torque at the ends of the sample periods alone, so wheel speed and body rate run straight between
them but for the body's own motion. A reading is then a weighted mean of the values at these ends; weight i is that of
the end i periods before the reading. One that is n + f periods late, 0 <= f < 1, has

    of an instant       1 - f at n,  f at n + 1
    of a whole period   (1 - f)^2 / 2 at n,  1/2 + f (1 - f) at n + 1,  f^2 / 2 at n + 2
"""

from __future__ import annotations

import math

import numpy as np

from satid_gym.core.jit import inline

DELAY_MAX = 4.0  # of a data sheet, sample periods
UNKNOWN_DELAY_MAX = 0.5  # standard deviation of what is unknown of it
DELAY_SIGMAS = 3.0  # beyond which the unknown part is not drawn
LINE = math.ceil(DELAY_MAX + DELAY_SIGMAS * UNKNOWN_DELAY_MAX) + 3  # readings that have weights, at most


def taps(late: float, averaged: bool) -> int:
    """Number of leading weights that may differ from 0, for a reading `late` sample periods late."""
    return math.ceil(late) + 1 + int(averaged)


@inline
def write_weights(late, averaged, out):
    """Weights (LINE,) of a reading `late` sample periods late; averaged: 1 for the mean of a period."""
    late = min(max(late, 0.0), LINE - 3.0)
    n = np.int64(late)
    f = late - n
    for i in range(out.shape[0]):
        out[i] = 0.0
    if averaged != 0:
        out[n], out[n + 1], out[n + 2] = 0.5 * (1.0 - f) ** 2, 0.5 + f * (1.0 - f), 0.5 * f * f
    else:
        out[n], out[n + 1] = 1.0 - f, f
