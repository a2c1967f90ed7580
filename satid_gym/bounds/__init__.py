"""Bounds on the accuracy of the inertia, for any estimator and any excitation."""

from satid_gym.bounds.envelope import envelope_bound, rate_cap, reference_limit, sample_information
from satid_gym.bounds.motion import TrueMotion
from satid_gym.bounds.posterior import episode_bounds, law_growth, population_bound, posterior_bound

__all__ = [
    "TrueMotion",
    "envelope_bound",
    "episode_bounds",
    "law_growth",
    "population_bound",
    "posterior_bound",
    "rate_cap",
    "reference_limit",
    "sample_information",
]
