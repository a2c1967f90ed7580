"""Commands by switches: a network of four outputs says for each axis to which side to turn, and whether to rest.

A network that commands rates hardly ever commands rest about all three axes at once by chance, and not for long: what
only a stop can tell is never found. With switches every other command of an untrained network is a stop, and commands
that are repeated for a few decisions make it a long one. The switches are random while PPO explores; the policy takes
the likelier position of each.

Where switches are reversals, each of three says whether its axis turns to the other side than it was commanded to. A
network that always says so flies a square wave, so that what is learned begins there.

As they are layers of tanh, what is shipped is a multilayer perceptron as others are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from satid_gym.policies.learned import Network
from satid_gym.sb3 import RateCommandVecEnv

SWITCHES = 4  # a side of each axis, and rest
REVERSALS = 3  # one for each axis
FIRST_LOGIT = 1.0  # of reversals, so that most are made
_LEANING = np.array([0.05, -0.05, 0.05])  # sides that axes at rest are taken to be on
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


def reversed_sides(command: np.ndarray, switches: np.ndarray) -> np.ndarray:
    """Rates (N, 3), each -1 or 1, of the commands (N, 3) in force and switches (N, 3) that are 0 or 1."""
    return np.where(command + _LEANING > 0.0, 1.0, -1.0) * (1.0 - 2.0 * switches)


def with_reversals(network: Network, command: slice) -> Network:
    """The network from observation to rates, of one from observation to the logits of reversals.

    Next to its layers, units of tanh carry the side p of each command, which is observed in the place `command`. Of p
    and the switch q, both -1 or 1, -p q = tanh(4 (p + q + 1)) - tanh(4 (p + q - 1)) - 1.

    Raises:
        ValueError: its activation is not tanh, or it has other than 3 outputs.
    """
    if network.activation != "tanh" or network.squashed or network.weights[-1].shape[0] != REVERSALS:
        raise ValueError("reversals are layers of tanh: they follow a network of tanh with 3 outputs, not squashed")
    steep, none = _STEEPNESS * np.eye(3), np.zeros(3)
    first = np.zeros((3, network.weights[0].shape[1]))
    first[:, command] = steep
    weights = [np.vstack([network.weights[0], first])]
    biases = [np.concatenate([network.biases[0], _STEEPNESS * _LEANING])]
    for i, (weight, bias) in enumerate(zip(network.weights[1:], network.biases[1:], strict=True), start=2):
        factor = _STEEPNESS if i == len(network.weights) else 1.0
        rows, columns = weight.shape
        block = np.block([[factor * weight, np.zeros((rows, 3))], [np.zeros((3, columns)), steep]])
        weights, biases = [*weights, block], [*biases, np.concatenate([factor * bias, none])]
    both = np.hstack([np.eye(3), np.eye(3)])
    weights += [_GATE * np.vstack([both, both]), np.hstack([np.eye(3), -np.eye(3)])]
    biases += [_GATE * np.repeat([1.0, -1.0], 3), none - 1.0]
    return Network(tuple(w.astype(np.float32) for w in weights), tuple(b.astype(np.float32) for b in biases))


class SwitchedVecEnv(RateCommandVecEnv):
    """`RateCommandVecEnv` whose actions are switches that stay for some decisions, which are one step.

    As in flight, every episode begins with a command of its own: those that `stagger` starts later begin at
    one of the next steps, and what follows an episode that ends within a step begins with the next step.

    Args:
        num_envs: number of environments.
        repeat: decisions of a step; an episode has a multiple of them.
        reversals: whether switches say to reverse, and not to which side.
        **settings: of `RateCommandVecEnv`.

    Raises:
        ValueError: the episode's decisions are no multiple of `repeat`.
    """

    def __init__(self, num_envs: int, *, repeat: int, reversals: bool = False, **settings: Any) -> None:
        super().__init__(num_envs, **settings)
        decisions = self.vector_env.problem.scenario.decisions
        if decisions % repeat:
            raise ValueError(f"repeat must divide the {decisions} decisions of an episode, got {repeat}")
        self._repeat, self._reversals = repeat, reversals
        self.action_space = spaces.MultiBinary(REVERSALS if reversals else SWITCHES)
        self._rates = np.zeros((num_envs, 3))

    def reset(self) -> np.ndarray:
        """Start an episode in every environment."""
        observations = super().reset()
        decision = self.vector_env.fleet.rows.tasks["decision"]  # more than 0 where `stagger` took time away
        decision -= decision % self._repeat
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the switches for `step_wait`."""
        command = self._observations[:, self.vector_env.problem.layout["command"]]
        switches = np.asarray(actions)
        self._rates = reversed_sides(command, switches) if self._reversals else commands(switches)
        super().step_async(self._rates)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take the decisions of a step, with the sum of their rewards; an episode that ended is over with the step."""
        observations, rewards, dones, infos = super().step_wait()
        early = np.zeros_like(dones)  # over before the step's last decision
        for _ in range(self._repeat - 1):
            early = dones
            super().step_async(self._rates)
            observations, more, ended, later = super().step_wait()
            rewards = rewards + np.where(dones, 0.0, more).astype(np.float32)
            for i in np.flatnonzero(ended & ~dones):
                infos[i] = later[i]
            dones = dones | ended
        if early.any():  # what followed was flown by the command of the episode before: begin again
            observations = self._begin(early)
        return observations, rewards, dones, infos

    def _begin(self, rows: np.ndarray) -> np.ndarray:
        """Start an episode in some rows (N,) bool; observations (N, size) of all."""
        self._observations, _ = self.vector_env.reset(options={"reset_mask": rows})
        self._begin_sums(rows)
        return self._observations
