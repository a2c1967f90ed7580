"""Networks of the full tensor flown with a filter of three moments."""

from __future__ import annotations

import numpy as np
import pytest

from satid_gym.core.observation import layout
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.learned.principal import widening
from satid_gym.policy import only_mission
from satid_gym.problem import problem

OTHERS = 6
PRODUCTS = (6, 7, 8)  # states of the full filter that the one of three moments lacks


def _observed(p, parts, correlation):
    """Observation of p parameters whose states are correlated as said, other parts as given."""
    places = layout(0, p, OTHERS, "body", 0, 3, True, True, (True, False), True)
    observed = np.zeros(max(place.stop for place in places.values()))
    for name, values in parts.items():
        observed[places[name]] = values
    observed[places["correlation"]] = correlation[:3, 3 : 3 + p].ravel()
    rest = [
        correlation[r, c]
        for r in range(len(correlation))
        for c in range(r + 1, len(correlation))
        if r >= 3 or c < 3 or c >= 3 + p
    ]
    observed[places["state_correlation"]] = rest
    return observed, places


def test_what_a_filter_of_three_moments_tells_is_seen_as_of_six_parameters():
    rng = np.random.default_rng(0)
    full = rng.uniform(-1.0, 1.0, (12, 12))
    full[list(PRODUCTS)] = full[:, list(PRODUCTS)] = 0.0
    kept = [i for i in range(12) if i not in PRODUCTS]
    inertia, std, rate, others = (rng.standard_normal(n) for n in (3, 3, 3, OTHERS))
    shared = {"rate": rate, "state_uncertainty": others, "time_left": 0.3, "inertia_walk": -1.0}
    narrow, places = _observed(3, {**shared, "inertia": inertia, "uncertainty": std}, full[np.ix_(kept, kept)])
    pairs = [std[[0, 1]].mean(), std[[0, 2]].mean(), std[[1, 2]].mean()]  # xy, xz, yz
    wide, _ = _observed(6, {**shared, "inertia": [*inertia, 0, 0, 0], "uncertainty": [*std, *pairs]}, full)
    np.testing.assert_allclose(widening(places) @ narrow, wide)


@pytest.mark.parametrize("parameters", ["principal", "full"])
def test_one_network_flies_both_filters(parameters):
    rng = np.random.default_rng(0)
    size = max(place.stop for place in layout(0, 6, OTHERS, "body", 0, 3, False, True).values())
    network = Network((rng.standard_normal((3, size)).astype(np.float32),), (np.zeros(3, np.float32),))
    policy = LearnedPolicy("any", network, "rate", 3.0, True, None, "body", True)
    posed = problem(
        estimator={"name": "adaptive", "parameters": parameters},
        include_covariance=True,
        control="rate",
        observation="body",
        include_walk=True,
    )
    policy.reset(only_mission(posed), [0])
    action = policy(np.ones((1, max(place.stop for place in posed.layout.values())), np.float32))
    assert action.shape == (1, 3)
    assert np.isfinite(action).all()


def test_layouts_of_other_kinds_are_left_alone():
    assert widening(layout(3, 3)) is None
    assert widening(layout(3, 6, form="body", actions=3)) is None
