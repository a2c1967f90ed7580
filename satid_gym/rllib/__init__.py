"""Ray's RLlib on the native vector environment; no other part of the library imports this one, which imports Ray."""

from satid_gym.rllib.env_runner import ArrayEnvRunner
from satid_gym.rllib.policy import learned_policy

__all__ = ["ArrayEnvRunner", "learned_policy"]
