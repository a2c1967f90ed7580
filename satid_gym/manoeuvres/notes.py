"""Notes on a design: what its reader should know of the data sheet, the filter and the flights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.manoeuvres.request import Request
from satid_gym.manoeuvres.trial import Trial
from satid_gym.policy import Mission

_NEES_MAX = 2.0  # that a consistent filter stays below
_RETURN_MAX = 3.0  # deg from the first attitude, beyond which there is a note
_DOUBTED_MAX = 0.01  # share of the flights with an alarm, which a consistent filter's limits allow


def remarks(mission: Mission, request: Request, trial: Trial, others: Sequence[Trial]) -> list[str]:
    """Notes, a line each.

    Args:
        mission: what was designed for.
        request: what was asked for.
        trial: flights of the manoeuvre.
        others: flights of its rivals.
    """
    notes = []
    if not mission.satellite.tolerances.kinds[0]:
        notes.append(
            "the data sheet gives no gyro bias, so the filter assumes none: with a bias, errors are larger than std"
        )
    if (nees := float(trial.nees.mean())) > _NEES_MAX:
        notes.append(f"the filter is overconfident: NEES is {nees:.2g}, and errors are larger than std by its root")
    if (share := float(trial.doubted.mean())) > _DOUBTED_MAX:
        notes.append(
            f"in {share:.0%} of the flights the filter restarted, inflated its noise or raised an alarm: std, a root "
            "mean square over flights, may be set by these; the median is of the typical flight"
        )
    if (trial.rate > 1.0).any():
        notes.append(f"in {(trial.rate > 1.0).mean():.0%} of the flights a rate was beyond its limit at some time")
    better = [other.name for other in others if other.keeps(request.cost_limit) and other.accuracy < trial.accuracy]
    if better:
        but = ", but not from rest to rest" if mission.control == "rate" else ""
        notes.append(f"more accurate within the limits{but}: {', '.join(better)}")
    if request.returns and (left := float(np.degrees(np.median(trial.turn[-1])))) > _RETURN_MAX:
        notes.append(f"it returns only to within {left:.2g} deg, in the median")
    return notes
