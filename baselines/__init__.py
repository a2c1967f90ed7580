"""Excitation designed by hand, which a learned policy has to beat."""

from baselines.registry import BASELINES, build, make_baseline, tuned_entry

__all__ = ["BASELINES", "build", "make_baseline", "tuned_entry"]
