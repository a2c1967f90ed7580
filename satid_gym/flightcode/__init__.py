"""C99 of filter, policy and rate loop for a flight computer, translated from the core."""

from satid_gym.flightcode.writer import write

__all__ = ["write"]
