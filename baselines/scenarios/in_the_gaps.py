"""Policies in the gaps between imaging windows: they excite until it is time to turn to the next target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.gaps import Gaps
from satid_gym.policy import Mission, Policy, observation_settings, show_filter

_MARGIN = 3.5  # of the rates of slews, see `RateMargin`


class InTheGaps:
    """A policy of rates that gives way to the operator when the way to the target takes what is left of the gap.

    Args:
        policy: what flies in the gaps; it observes what it would alone.
        settle: s before the opening at which the target is to be held.
    """

    def __init__(self, policy: Policy, settle: float = 3.0) -> None:
        self.settle = check_number("settle", settle)
        self.name, self.kind = policy.name, policy.kind
        vars(self).update(observation_settings(policy))
        self._policy = policy

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare both.

        Raises:
            ValueError: the environment takes torques, or there are no windows.
        """
        self._gaps = Gaps([mission], _MARGIN, self.settle, self.name)
        self._gaps.begin(len(seeds))
        self._policy.reset(mission, seeds)

    def see(self, beliefs: np.ndarray, tasks: np.ndarray) -> None:
        """Show the policy the filters (N,) that fly, where it plans with them."""
        show_filter(self._policy, beliefs, tasks)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        return self._gaps(observation, self._policy(observation))
