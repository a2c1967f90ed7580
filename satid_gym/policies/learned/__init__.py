"""Learned policies: small networks, their files, and those that are shipped."""

from satid_gym.policies.learned.network import Network
from satid_gym.policies.learned.policy import LearnedPolicy

__all__ = ["LearnedPolicy", "Network"]
