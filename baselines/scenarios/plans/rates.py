"""Plan of the oracle where wheels avoid a band of speed: body rates, decision by decision."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.policies.clear_square import ClearSquarePolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policy import Kind, Mission, Policy, check_commands_rates

_SPAN = 30  # decisions, the longest stretch that an edit changes, but for shifts
_SHIFT = 4  # decisions, the longest shift
_RATE_MAX = 0.95  # of the rate limit
_LEVELS = (-_RATE_MAX, -0.5, 0.0, 0.5, _RATE_MAX)


class RatesPlan:
    """Rates that were planned for each episode, whatever is observed.

    Args:
        rates: (N, decisions, 3) over the rate limit.
    """

    name = "rates plan"
    kind: Kind = "reference"

    def __init__(self, rates: np.ndarray) -> None:
        self.rates = rates

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Begin.

        Raises:
            ValueError: the environment takes torques.
        """
        check_commands_rates(mission, self.name)
        self._decision = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        self._decision += 1
        return self.rates[:, self._decision - 1]


class Recorder:
    """A policy whose actions are kept; its `rates` are (N, decisions, 3)."""

    def __init__(self, policy: Policy) -> None:
        self.name, self.kind, self._policy = policy.name, policy.kind, policy
        self._actions: list[np.ndarray] = []

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the policy."""
        self._policy.reset(mission, seeds)
        self._actions = []

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Its action (N, 3)."""
        self._actions.append(self._policy(observation))
        return self._actions[-1]

    @property
    def rates(self) -> np.ndarray:
        """What it has commanded since the reset."""
        return np.stack(self._actions, axis=1)


def starts() -> list[Policy]:
    """Policies with whose flights the search begins."""
    return [ClearSquarePolicy(), *(MPCPolicy(30, edits=60, margin=3.5, amplitude=a) for a in (0.6, 0.8, 1.0))]


def edited(plan: np.ndarray, others: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A plan (decisions, 3) after one to three changes; some take the rest of another plan (K, decisions, 3)."""
    plan, decisions = plan.copy(), len(plan)
    for _ in range(rng.integers(1, 4)):
        first = rng.integers(decisions)
        here, axis, kind = slice(first, first + rng.integers(2, _SPAN)), rng.integers(3), rng.random()
        if kind < 0.3:
            plan[here, axis] *= -1.0
        elif kind < 0.5:
            plan[here] = rng.choice([-1.0, 0.0, 1.0], 3) * rng.uniform(0.2, _RATE_MAX)
        elif kind < 0.65:
            plan[first:] = np.roll(plan[first:], rng.integers(-_SHIFT, _SHIFT + 1), axis=0)
        elif kind < 0.8:
            plan[here] = np.clip(plan[here] * rng.uniform(0.5, 1.6), -_RATE_MAX, _RATE_MAX)
        elif kind < 0.9:
            plan[here, axis] = rng.choice(_LEVELS)
        else:
            plan[first:] = others[rng.integers(len(others))][first:]
    return plan
