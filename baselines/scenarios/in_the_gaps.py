"""Policies in the gaps between imaging windows: they excite until it is time to turn to the next target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.control.pointing import View
from satid_gym.policies.operator import OperatorPolicy
from satid_gym.policy import Mission, Policy, observation_settings, show_filter


class InTheGaps(OperatorPolicy):
    """A policy of rates that gives way to the operator when the way to the target takes what is left of the gap.

    Args:
        policy: what flies in the gaps; it observes what it would alone.
        settle: s before the opening at which the target is to be held.
    """

    def __init__(self, policy: Policy, settle: float = 3.0) -> None:
        super().__init__(settle)
        self.name, self.kind = policy.name, policy.kind
        vars(self).update(observation_settings(policy))
        self._policy = policy

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare both.

        Raises:
            ValueError: the environment takes torques, or there are no windows.
        """
        super().reset(mission, seeds)
        self._policy.reset(mission, seeds)

    def see(self, beliefs: np.ndarray, tasks: np.ndarray) -> None:
        """Show the policy the filters (N,) that fly, where it plans with them."""
        show_filter(self._policy, beliefs, tasks)

    def _flown(self, observation: np.ndarray, view: View) -> np.ndarray:
        guide = self._pointing
        excitation = self._policy(observation)
        slew = guide.slew(view, guide.fastest(view))
        return np.where(self._spare(view)[:, None] > 0.0, excitation, slew)
