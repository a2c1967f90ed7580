"""Learned policies: small networks in NumPy, in files that execute no code (`satid_gym.policies.learned.files`)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from satid_gym.config import check_flag, check_integer, check_number, unknown_name
from satid_gym.control.corners.features import check_features
from satid_gym.control.corners.tour import CornerTour
from satid_gym.control.corners.tour import Memory as TourMemory
from satid_gym.control.decoded_observation import check_observation
from satid_gym.control.gaps import SETTLE
from satid_gym.control.mode_limit import ModeLimit
from satid_gym.control.rate_loop import rate_loop
from satid_gym.core.observation import Form
from satid_gym.policies.learned.files import files_of, read_policy, write_policy
from satid_gym.policies.learned.network import Network, NetworkMemory
from satid_gym.policies.learned.principal import fitted
from satid_gym.policy import Kind, Mission
from satid_gym.problem import CONTROLS

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_OWN = (
    *("name", "control", "margin", "include_covariance", "observation", "include_walk"),
    *("repeat", "spares_modes", "corner_features", "settle", "is_shaped"),
)


class LearnedPolicy:
    """Policy of a network that commands body rates (through the rate loop) or wheel torque (directly).

    Args:
        name: its name in tables.
        network: maps observations to commands.
        control: "rate" or "torque".
        margin: margin of the rate loop; see `RateLoop`.
        include_covariance: whether the network's observations include the filter's whole covariance.
        details: its training and scores; kept in the JSON file.
        observation: form of the network's observations, "wheels" or "body".
        include_walk: whether they include the random walk of the inertia that the filter uses.
        repeat: decisions for which each command of the network is repeated.
        spares_modes: whether panels and tanks are kept inside their limit, see `satid_gym.control.mode_limit`.
        corner_features: for a network that scores corners of the rate envelope: which features of a corner it takes,
            `satid_gym.control.corners.features.FEATURES`; the open corner with the highest score is flown.
        settle: s before an imaging window opens at which such a policy, which flies in the gaps between windows, is on
            the target.
        is_shaped: whether such a policy goes to its corner only as far in each decision as panels allow, see
            `satid_gym.control.mode_shaping`, in place of flying open corners only.

    Attributes:
        tour: of a policy that scores corners, from `reset` on.

    Raises:
        ValueError: control or observation is unknown, the name has invalid characters, a number or a flag is not valid,
            or a network that commands rates has other than 3 outputs, or one that tours corners other inputs and
            outputs than it takes.
    """

    kind: Kind = "learned"

    def __init__(
        self,
        name: str,
        network: Network,
        control: str,
        margin: float,
        include_covariance: bool = False,
        details: Mapping[str, Any] | None = None,
        observation: Form = "wheels",
        include_walk: bool = False,
        repeat: int = 1,
        spares_modes: bool = False,
        corner_features: Sequence[str] = (),
        settle: float = SETTLE,
        is_shaped: bool = False,
    ) -> None:
        for what, given, known in (("control", control, CONTROLS), ("observation", observation, get_args(Form))):
            if given not in known:
                raise unknown_name(f"{what} of a learned policy", given, known)
        self.observation: Form = observation
        margin = check_number("margin of a learned policy", margin)
        self.corner_features = check_features(corner_features)
        shape = network.weights[0].shape[1], network.weights[-1].shape[0]
        inputs = len(self.corner_features)
        if inputs and (shape != (inputs, 1) or (control, observation) != ("rate", "body") or repeat != 1):
            raise ValueError(
                f"a network that takes {inputs} features of corners has as many inputs and 1 output, commands rates, "
                f'observes "body" and decides each time; got {shape}, {control!r}, {observation!r} and repeat {repeat}'
            )
        if control == "rate" and not inputs and shape[1] != 3:
            raise ValueError(f"a network that commands rates has 3 outputs, not {network.weights[-1].shape[0]}")
        check_name(name)
        self.settle = check_number("settle of a learned policy", settle)
        self.include_covariance = check_flag("include_covariance of a learned policy", include_covariance)
        self.include_walk = check_flag("include_walk of a learned policy", include_walk)
        self.spares_modes = check_flag("spares_modes of a learned policy", spares_modes)
        self.is_shaped = check_flag("is_shaped of a learned policy", is_shaped)
        if self.is_shaped and not inputs:
            raise ValueError("is_shaped is of policies that score corners: give corner_features, or spares_modes=True")
        self.name, self.network, self.control, self.margin = name, network, control, margin
        self.repeat, self.details = check_integer("repeat of a learned policy", repeat), dict(details or {})

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the network was trained for another observation.
        """
        if mission.observation != self.observation:
            raise ValueError(
                f'policy {self.name} observes "{self.observation}", this environment gives "{mission.observation}": '
                f'give observation="{self.observation}"'
            )
        self._layout, self._decisions = mission.layout, 0
        if self.corner_features:
            self.tour = CornerTour(
                [mission],
                self.margin,
                features=self.corner_features,
                settle=self.settle,
                is_shaped=self.is_shaped,
            )
            self.tour.begin(len(seeds))
            return
        self._network = fitted(self.network, mission.layout)
        size, expected = max(p.stop for p in mission.layout.values()), self._network.weights[0].shape[1]
        if size != expected:
            raise ValueError(
                f"policy {self.name} takes observations of {expected} numbers, this environment gives {size}: it must "
                "have as many wheels and inertia parameters as the one it was trained on, and "
                f"include_covariance={self.include_covariance} and include_walk={self.include_walk}; tolerances, "
                "panels, tanks and a star tracker in the data sheet add numbers too"
            )
        if self.control == "torque" and mission.control == "rate":
            raise ValueError(f'policy {self.name} commands wheel torque, not body rates: make it with control="torque"')
        outputs, wheels = self.network.weights[-1].shape[0], mission.satellite.wheels.count
        if self.control == "torque" and outputs != wheels:
            raise ValueError(f"policy {self.name} commands {outputs} wheels, the satellite has {wheels}")
        self._command = np.zeros((len(seeds), outputs))
        loop = ModeLimit if self.spares_modes else rate_loop
        self._loop = loop([mission], self.margin) if self.control == "rate" else None

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n).

        Raises:
            ValueError: the observation is not finite, or its shape is wrong.
            RuntimeError: `reset` was not called.
        """
        if not hasattr(self, "_layout"):
            raise RuntimeError(
                f"policy {self.name} does not know its satellite yet: call reset(mission, seeds) before the first "
                "decision, or satid_gym.evaluation.fly, which does"
            )
        check_observation(observation, self._layout)
        if self.corner_features:
            return self.tour(observation, self.score)
        if self._decisions % self.repeat == 0:
            self._command = self._network(observation)
        self._decisions += 1
        return np.clip(self._command, -1.0, 1.0) if self._loop is None else self._loop(observation, self._command)

    @property
    def memory(self) -> TourMemory | NetworkMemory:
        """What is remembered of the episodes since `reset`."""
        if self.corner_features:
            return self.tour.memory
        modes = self._loop.state() if isinstance(self._loop, ModeLimit) else np.zeros((0, 0, 2))
        return NetworkMemory(self._decisions, self._command, modes)

    @memory.setter
    def memory(self, memory: TourMemory | NetworkMemory) -> None:
        if isinstance(memory, TourMemory):
            self.tour.memory = memory
            return
        self._decisions, self._command = memory.decisions, memory.command
        if isinstance(self._loop, ModeLimit):
            self._loop.restore(memory.modes)

    def score(self, features: np.ndarray) -> np.ndarray:
        """Scores (N, 8) of corners by their features (N, 8, features); for a policy that tours corners."""
        return self.network(features)[:, :, 0]

    @property
    def settings(self) -> dict[str, Any]:
        """Name and settings, of which with the network a policy is made."""
        return {name: getattr(self, name) for name in _OWN}

    def save(self, path: Path | str) -> None:
        """Write `path`.safetensors and `path`.json, each atomically; the second has the first's checksum."""
        write_policy(path, self.settings, self.network, self.details)

    @classmethod
    def load(cls, path: Path | str) -> LearnedPolicy:
        """Policy from the files that `save` wrote; `path` with or without an ending.

        Raises:
            FileNotFoundError: one of the two files is missing.
            ValueError: a file is damaged, of another format, without the checksum, or has invalid content.
        """
        settings, network, details = read_policy(path, _OWN)
        try:
            return cls(network=network, details=details, **settings)  # older files lack some, which are the defaults
        except (ValueError, TypeError) as error:
            _, text = files_of(path)
            raise ValueError(f"{text} describes no policy: {error!s}; copy the policy again") from error


def check_name(name: str) -> None:
    """Refuse names with invalid characters; they become names of files and cells of tables.

    Raises:
        ValueError: the name is empty, long, or holds other than letters, digits, dot, dash and underscore.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ValueError(
            f"a policy's name is up to 64 letters, digits, dots, dashes and underscores, first a letter or digit; "
            f"got {name!r}"
        )
