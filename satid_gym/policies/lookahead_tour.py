"""Learned tour that looks ahead: each corner is tried in rehearsal, with the tour from there on, and the best is flown.

A tour of corners decides by a learned score of what is observed. Here the filter that flies rehearses what would come
of each corner (`control.planning.rehearsal`), the tour deciding all that follows; the corner that promises to lose the
least is flown. That is one step of policy improvement: but for what a rehearsal does not foresee, the result is no
worse than the tour. What follows holds slews to imaging windows too, so that excitation before a slew takes account of
it. With `edits`, the best of these plans is one that `filter_mpc` improves further.
Source: Bertsekas, Rollout, Policy Iteration, and Distributed Reinforcement Learning (2020), ch. 2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.corners.tour import CORNERS, CornerTour, Memory
from satid_gym.control.planning.rehearsal import Flights, Trail
from satid_gym.control.planning.rollout import begin_rollouts, roll_out
from satid_gym.policies.filter_mpc import FilterMPCPolicy, scratch_of
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.shipped import find
from satid_gym.policy import Kind, Mission

_CHOICES = len(CORNERS)


class LookaheadTourPolicy(FilterMPCPolicy):
    """Learned tour with a look ahead; for control "rate" and the MomentumEKF.

    Args:
        tour: learned policy that scores corners, by name, path or itself.
        horizon: decisions ahead.
        edits: changes of the best plan that are tried in a decision; none where there are imaging windows.
        tail, caution, step: see `FilterMPCPolicy`.
        settle: s before an imaging window opens at which the target is to be held; as long as the tour's where None.

    Attributes:
        tour_memory: what the tour remembers of each episode.

    Raises:
        ValueError: a setting is out of range, or the policy scores no corners.
    """

    name = "lookahead_tour"
    kind: Kind = "learned"
    _EDITS_MIN = 0

    def __init__(
        self,
        tour: str | LearnedPolicy = "rigid_tour",
        horizon: int = 20,
        edits: int = 0,
        tail: float = 20.0,
        caution: float = 1.0,
        step: float = 0.1,
        settle: float | None = None,
    ) -> None:
        self._policy = find(tour) if isinstance(tour, str) else tour
        if not self._policy.corner_features:
            raise ValueError(f"{self._policy.name} scores no corners: give a tour, such as rigid_tour")
        super().__init__(horizon, edits, tail, caution, step=step, margin=self._policy.margin)
        self.include_covariance, self.include_walk = self._policy.include_covariance, self._policy.include_walk
        self.settle = self._policy.settle if settle is None else check_number("settle", settle)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: as `FilterMPCPolicy.reset`; what the tour takes is not observed; or edits where a plan would
                miss imaging windows.
        """
        super().reset(mission, seeds)
        if self.edits and mission.scenario.operations is not None:
            raise ValueError(
                f"edits of a plan take no account of imaging windows, and scenario {mission.scenario.name!r} has some: "
                "give edits=0"
            )
        own = self._policy
        self._tour = CornerTour([mission], own.margin, features=own.corner_features, settle=self.settle)
        self._tour.begin(len(seeds))
        self.tour_memory = self._tour.memory

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3).

        Raises:
            RuntimeError: `see` was not called since the last decision.
        """
        flights, before = self._flown(), self.tour_memory
        plans, losses, after = self._rolled_out(flights, observation)
        best = _CHOICES * np.arange(len(losses)) + np.argmin(losses, axis=1)
        self.tour_memory = after.take(best)
        if not self.edits:
            self._left -= 1
            return plans[best, 0]
        action = self._planned(flights, np.clip(plans[best] / self._shares, -1.0, 1.0)[:, None])
        self._tour.memory = self.tour_memory
        self._tour.note(before, action)
        self.tour_memory = self._tour.memory
        return action

    def _rolled_out(self, flights: Flights, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray, Memory]:
        """Plans (8 N, H, 3) that begin with each corner, losses (N, 8), and the memory after the first decision."""
        each = np.repeat(np.arange(len(observation)), _CHOICES)
        first = np.tile(np.eye(_CHOICES), (len(observation), 1))
        trail, scratch = Trail.of(flights, len(each)), scratch_of(flights)
        seen = observation[each].astype(np.float32)
        begin_rollouts(trail, flights, _CHOICES, self.caution)
        self._tour.memory = self.tour_memory.take(each)
        actions, last = [self._tour(seen, lambda _: first)], np.zeros(len(each))
        after = self._tour.memory
        roll_out(trail, actions[0], scratch, seen)
        for _ in range(1, self._ahead):
            actions.append(self._tour(seen, self._policy.score))
            last = trail.losses.copy()
            roll_out(trail, actions[-1], scratch, seen)
        losses = trail.losses + self.tail * (trail.losses - last)
        return np.stack(actions, axis=1), losses.reshape(-1, _CHOICES), after
