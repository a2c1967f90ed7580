"""Policies: scripted, closed-loop and learned ones, with the shipped settings and networks."""

from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.registry import BASELINES, RATE_BASELINES, build, make_baseline, tuned_entry
from satid_gym.policies.shipped import find, names, shipped

__all__ = [
    "BASELINES",
    "RATE_BASELINES",
    "LearnedPolicy",
    "build",
    "find",
    "make_baseline",
    "names",
    "shipped",
    "tuned_entry",
]
