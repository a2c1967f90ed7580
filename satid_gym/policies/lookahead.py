"""Learned policy that looks ahead: the filter that flies rehearses what would come of it, and the best is flown.

A tour of corners is tried in rehearsal from each corner (`control.planning.rehearsal`), the tour deciding all that
follows; where there are imaging windows, a slew to the next one that begins now is tried too. The choice that promises
to lose the least is flown. That is one step of policy improvement: within the horizon, and but for what a rehearsal
does not foresee, such as the window after the next one, the result is no worse than the tour. What follows holds the
slew and whether the window is missed, so that excitation before a slew takes account of it. With `edits`, the search of
`filter_mpc` improves the best of these plans. A network that commands rates proposes one plan, its own flight.
Source: Bertsekas, Rollout, Policy Iteration, and Distributed Reinforcement Learning (2020), ch. 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.corners.tour import CORNERS, Memory
from satid_gym.control.planning.rehearsal import Flights, Trail
from satid_gym.control.planning.rollout import begin_rollouts, roll_out
from satid_gym.policies.filter_mpc import FilterMPCPolicy, scratch_of
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.network import NetworkMemory
from satid_gym.policies.learned.shipped import find
from satid_gym.policy import Kind, Mission

_MISS = 10.0  # weight of imaging windows, see `rehearsal.decide`


class LookaheadPolicy(FilterMPCPolicy):
    """Learned policy with a look ahead; for control "rate" and the MomentumEKF.

    Args:
        policy: learned policy that commands body rates, by name, path or itself.
        horizon: decisions ahead.
        edits: changes of the best plan that are tried in a decision; none where there are imaging windows, some for a
            policy that scores no corners.
        tail, caution, step: see `FilterMPCPolicy`.
        settle: s before an imaging window opens at which the target is to be held; None: the policy's own.

    Attributes:
        policy: the learned policy, a copy.

    Raises:
        ValueError: a setting is out of range, no policy has that name, it commands torques or observes wheel by wheel,
            or it scores no corners and there are no edits.
    """

    name = "lookahead"
    kind: Kind = "learned"
    _EDITS_MIN = 0

    def __init__(
        self,
        policy: str | LearnedPolicy = "rigid_tour",
        horizon: int = 20,
        edits: int = 0,
        tail: float = 20.0,
        caution: float = 1.0,
        step: float = 0.1,
        settle: float | None = None,
    ) -> None:
        own = self.policy = copy(find(policy) if isinstance(policy, str) else policy)
        if own.control != "rate" or own.observation != "body":
            raise ValueError(
                f'{own.name} commands torque or observes wheel by wheel: give a policy for control="rate" and '
                'observation="body", such as rigid_tour'
            )
        super().__init__(horizon, edits, tail, caution, step=step, margin=own.margin)
        self._tours = bool(own.corner_features)
        if not self._tours and not self.edits:
            raise ValueError(
                f"{own.name} scores no corners: all that it tries is its own flight; give edits, such as 16"
            )
        self.include_covariance, self.include_walk = own.include_covariance, own.include_walk
        own.settle = own.settle if settle is None else check_number("settle", settle)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: as `FilterMPCPolicy.reset`; what the policy takes is not observed; or edits where a plan would
                miss imaging windows.
        """
        super().reset(mission, seeds)
        slews = mission.scenario.operations is not None
        if self.edits and slews:
            raise ValueError(
                f"edits of a plan take no account of imaging windows, and scenario {mission.scenario.name!r} has some: "
                "give edits=0 and a policy that scores corners"
            )
        self.policy = copy(self.policy)  # a copy of this one may be flying
        self.policy.reset(mission, seeds)
        self._choices = len(CORNERS) + slews if self._tours else 1
        self._notes_rates = bool(self.edits) or slews or not self.policy.is_shaped  # half way, a rate has no side

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3).

        Raises:
            RuntimeError: `see` was not called since the last decision.
        """
        flights, before = self._flown(), self.policy.memory
        plans, losses, after = self._rolled_out(flights, observation, before)
        losses = np.where(np.isfinite(losses), losses, np.inf)
        best = self._choices * np.arange(len(losses)) + np.argmin(losses, axis=1)
        if self.edits:
            action = self._planned(flights, np.clip(plans[best] / self._shares, -1.0, 1.0)[:, None])
        else:
            action, self._left = plans[best, 0], self._left - 1
        self.policy.memory = after.take(best)
        if isinstance(before, Memory) and self._notes_rates:
            self.policy.tour.note(before, action)
        return action

    def _rolled_out(
        self, flights: Flights, observation: np.ndarray, memory: Memory | NetworkMemory
    ) -> tuple[np.ndarray, np.ndarray, Memory | NetworkMemory]:
        """Plans (K N, H, 3) of K choices each, losses (N, K), and the memory after the first decision."""
        each = np.repeat(np.arange(len(observation)), self._choices)
        trail, scratch = Trail.of(flights, len(each)), scratch_of(flights)
        seen = observation[each].astype(np.float32)
        begin_rollouts(trail, flights, self._choices, self.caution)
        self.policy.memory = memory.take(each)
        choice = np.arange(len(each)) % self._choices
        leaves = choice == len(CORNERS)
        corners = np.eye(self._choices)[choice, : len(CORNERS)]
        actions, last = [self._fly(seen, leaves, corners)], np.zeros(len(each))
        after = self.policy.memory
        roll_out(trail, actions[0], _MISS, scratch, seen)
        for _ in range(1, self._ahead):
            seen[~np.isfinite(seen).all(axis=1)] = 0.0  # of a rehearsal that has broken down: its loss is not finite
            actions.append(self._fly(seen, leaves))
            last = trail.losses.copy()
            roll_out(trail, actions[-1], _MISS, scratch, seen)
        losses = trail.losses + self.tail * (trail.losses - last)
        return np.stack(actions, axis=1), losses.reshape(-1, self._choices), after

    def _fly(self, observation: np.ndarray, leaves: np.ndarray, corners: np.ndarray | None = None) -> np.ndarray:
        """Actions (R, 3) of the policy; to given corners (R, 8), or in a slew where an episode `leaves` (R,)."""
        if not self._tours:
            return self.policy(observation)
        return self.policy.tour(observation, self.policy.score if corners is None else lambda _: corners, leaves)
