"""Truth from elsewhere: the environment on another simulator's satellite."""

from satid_gym.truth.protocol import Episode, State, Truth

__all__ = ["Episode", "State", "Truth"]
