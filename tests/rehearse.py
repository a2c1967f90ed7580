"""Rehearsal of given plans, as `filter_mpc` rehearses its own."""

import numpy as np

from satid_gym.control.planning.rehearsal import Flights, Trail
from satid_gym.control.planning.rehearsal_search import Search, improve_rehearsed
from satid_gym.policies.filter_mpc import scratch_of


def rehearse(policy, plans):
    """Trails of plans (N, H, 3) of rates over their limit, one for each of the flights that the policy saw last."""
    plans, none, flights = np.array(plans, dtype=float), Search(0, 0.0, policy.caution), policy._flights
    trails, streams = [], np.zeros((1, 4), np.uint64)
    for i, plan in enumerate(plans):
        one = Flights(*(part[i : i + 1].copy() for part in flights))
        trails.append(Trail.of(flights, len(plan) + 1))
        both, proposals = (trails[-1], Trail.of(one, 2)), np.empty((1, 0, len(plan), 3))
        improve_rehearsed(one, plan[None], proposals, np.ones(3), both, scratch_of(one), streams, none)
    return trails
