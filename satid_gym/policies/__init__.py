"""Policies: scripted, closed-loop and learned ones, with the shipped settings and networks."""

from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.shipped import find, names, shipped
from satid_gym.policies.registry import BASELINES, RATE_BASELINES, build, make_baseline, tuned_entry

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
