"""Commands by switches: a network of four outputs says for each axis to which side to turn, and whether to rest.

A network that commands rates hardly ever commands rest about all three axes at once by chance, and not for long: what
only a stop can tell is never found. With switches every other command of an untrained network is a stop, and commands
that are repeated for a few decisions make it a long one. The switches are random while PPO explores; the policy takes
the likelier position of each.

As they are layers of tanh, what is shipped is a multilayer perceptron as others are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from satid_gym.policies.learned import Network
from satid_gym.sb3 import RateCommandVecEnv

SWITCHES = 4  # a side of each axis, and rest
_STEEPNESS = 20.0  # of the step from logit to position
_GATE = 4.0  # of the layer that lets the sides pass or not: what passes differs from 1 by e^-8


def commands(switches: np.ndarray) -> np.ndarray:
    """Rates (N, 3), each -1 or 1 or all 0, of switches (N, 4) that are 0 or 1."""
    return np.where(switches[:, 3:] > 0, 0.0, 2.0 * switches[:, :3] - 1.0)


def with_switches(network: Network) -> Network:
    """The network from observation to rates, of one from observation to the switches' logits.

    Two layers follow: p = tanh(20 logit), and for each axis (tanh(4 (p - 1 - r)) + tanh(4 (p + 1 + r))) / 2, which is
    p where the switch of rest has r = -1, and 0 where it has 1.

    Raises:
        ValueError: its activation is not tanh, or it has other than 4 outputs.
    """
    if network.activation != "tanh" or network.squashed or network.weights[-1].shape[0] != SWITCHES:
        raise ValueError("switches are layers of tanh: they follow a network of tanh with 4 outputs, not squashed")
    side, rest = np.eye(3), np.ones((3, 1))
    gate = _GATE * np.block([[side, -rest], [side, rest]])
    weights = [*network.weights[:-1], _STEEPNESS * network.weights[-1], gate, 0.5 * np.hstack([side, side])]
    biases = [*network.biases[:-1], _STEEPNESS * network.biases[-1], _GATE * np.repeat([-1.0, 1.0], 3), np.zeros(3)]
    return Network(tuple(w.astype(np.float32) for w in weights), tuple(b.astype(np.float32) for b in biases))


class SwitchedVecEnv(RateCommandVecEnv):
    """`RateCommandVecEnv` whose actions are switches that stay for some decisions, which are one step.

    Args:
        num_envs: number of environments.
        repeat: decisions of a step; an episode has a multiple of them.
        **settings: of `RateCommandVecEnv`.

    Raises:
        ValueError: the episode's decisions are no multiple of `repeat`.
    """

    def __init__(self, num_envs: int, *, repeat: int, **settings: Any) -> None:
        super().__init__(num_envs, **settings)
        decisions = self.vector_env.problem.scenario.decisions
        if decisions % repeat:
            raise ValueError(f"repeat must divide the {decisions} decisions of an episode, got {repeat}")
        self._repeat = repeat
        self.action_space = spaces.MultiBinary(SWITCHES)
        self._rates = np.zeros((num_envs, 3))

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the switches for `step_wait`."""
        self._rates = commands(np.asarray(actions))
        super().step_async(self._rates)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take the decisions of a step, with the sum of their rewards; an episode that ended is over with the step."""
        observations, rewards, dones, infos = super().step_wait()
        for _ in range(self._repeat - 1):
            super().step_async(self._rates)
            observations, more, ended, later = super().step_wait()
            rewards = rewards + np.where(dones, 0.0, more).astype(np.float32)
            for i in np.flatnonzero(ended & ~dones):
                infos[i] = later[i]
            dones = dones | ended
        return observations, rewards, dones, infos
