"""Excitation designed by hand, which a learned policy has to beat."""

from satid_gym.policies.registry import BASELINES, build, make_baseline, tuned_entry

__all__ = ["BASELINES", "build", "make_baseline", "tuned_entry"]
