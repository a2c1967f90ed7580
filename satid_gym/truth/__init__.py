"""Truth from another simulator or a test bench."""

from satid_gym.truth.protocol import Episode, State, Truth

__all__ = ["Episode", "State", "Truth"]
