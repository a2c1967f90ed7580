"""Numbers of an observation: bounded, and standard deviations by their logarithm."""

from __future__ import annotations

import numpy as np

from satid_gym.core.jit import inline

BOUND = 10.0
LOG_OFFSET = 2.0  # a standard deviation of 1 % of its scale is observed as 0


@inline
def write(out, i, value):
    """Write a number, cut to the bound; the next place."""
    out[i] = min(max(value, -BOUND), BOUND)
    return i + 1


@inline
def log_share(value):
    """What is observed of a standard deviation, or another positive number, over its scale; -10 of 0."""
    return np.log10(value) + LOG_OFFSET if value > 0.0 else -BOUND
