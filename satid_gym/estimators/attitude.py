"""Attitude of the filter: what it is told of a star tracker."""

from __future__ import annotations

import numpy as np

from satid_gym.star_tracker import StarTracker

ATTITUDE_STD_MIN = 1e-8  # rad: a tracker said to be noiseless is believed this far


def write_attitude(row: np.void, tracker: StarTracker, first: int, period: float) -> None:
    """Write the tracker to a record of `core.belief.attitude`, whose error the mean has from index `first` on.

    `period` is that of samples, s.
    """
    row["first"], row["boresight"][0] = first, tracker.boresight
    row["period"], row["noisy"] = period, tracker.across_std > 0.0 or tracker.round_std > 0.0
    row["across_variance"] = max(tracker.across_std, ATTITUDE_STD_MIN) ** 2
    row["round_variance"] = max(tracker.round_std, ATTITUDE_STD_MIN) ** 2
