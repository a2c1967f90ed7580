"""Looks of a policy: its place among those of its kind, by its name alone, so that it is the same on every page."""

from __future__ import annotations

import zlib

from agents.benchmark.stored import MARK
from satid_gym.policies.learned.shipped import names, rate_names
from satid_gym.policies.registry import BASELINES, RATE_BASELINES

_OTHERS = 100_000  # further places, for policies that the registry does not have


def place(policy: str) -> int:
    """A policy's place among its kind's colours and dashes.

    Baselines and shipped policies stand as the registry has them. Any other, such as a policy given by its path,
    comes after them, at a place that its name fixes.
    """
    policy = policy.removesuffix(MARK)
    for registered in ([*BASELINES, *RATE_BASELINES], [*names(), *rate_names()]):
        if policy in registered:
            return registered.index(policy)
    return len(BASELINES) + len(RATE_BASELINES) + zlib.crc32(policy.encode()) % _OTHERS
