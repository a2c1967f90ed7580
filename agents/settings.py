"""Settings of a training run, and the named ones that are kept as data."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from agents.learned import check_name
from baselines.provenance import read_json
from satid_gym.config import unknown_name
from satid_gym.problem import SatelliteLike
from satid_gym.reward import RewardSettings, reward_settings
from satid_gym.satellite import SATELLITES, Satellite

NAMED = Path(__file__).parent / "settings"


@dataclass(frozen=True, kw_only=True)
class TrainSettings:
    """Everything that decides what a training run learns."""

    name: str = "ppo"
    """What tables call the policy."""
    satellite: str = "random"
    """Satellite to train on; "random" draws from all three."""
    wheel_scales: tuple[float, ...] = (1.0,)
    """Factors on the wheels' speed limit; each satellite is flown with each (0.1: as in scenario "tight")."""
    inertia: str = "random"
    """How the inertia varies: a mode, or "random"; laws are randomised."""
    scenario: str = "default"
    """The world to train in."""
    control: Literal["rate", "torque"] = "rate"
    """What the network commands: body rates through the rate loop, or wheel torque at once."""
    include_covariance: bool = True
    """Whether the network sees the filter's whole covariance."""
    margin: float = 2.6
    """Of the rate loop, in standard deviations of one decision's noise."""
    reward: RewardSettings = field(default_factory=RewardSettings)
    """What pays in training."""
    steps: int = 10_000_000
    """Decisions to train for, all environments together."""
    seed: int = 0
    """Of environments, network and exploration."""
    num_envs: int = 192
    """Environments side by side."""
    rollout: int = 100
    """Decisions of each environment between two updates."""
    batch_size: int = 4800
    """Decisions in a minibatch."""
    epochs: int = 5
    """Passes over a rollout."""
    learning_rate: float = 5e-4
    """At the start."""
    final_learning_rate: float = 5e-5
    """At the end; linear between."""
    gamma: float = 0.985
    """Discount."""
    gae_lambda: float = 0.95
    """Of generalised advantage estimation."""
    clip_range: float = 0.2
    """Of PPO's ratio."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    hidden: tuple[int, ...] = (64, 64)
    """Layers of policy and value network."""
    log_std: float = 0.5
    """First logarithm of the exploration's standard deviation."""
    hold: int = 20
    """Decisions for which state-dependent exploration keeps its direction."""
    evaluate_every: int = 1_000_000
    """Decisions between evaluations on validation seeds."""
    evaluation_episodes: int = 32
    """Episodes of an evaluation, on each satellite."""

    def __post_init__(self) -> None:
        check_name(self.name)
        if (self.num_envs * self.rollout) % self.batch_size:
            raise ValueError(
                f"batch_size must divide num_envs * rollout = {self.num_envs * self.rollout}, got {self.batch_size}"
            )
        if self.satellite != "random" and self.satellite not in SATELLITES:
            raise unknown_name("satellite", self.satellite, [*SATELLITES, "random"])
        if self.steps < 1:
            raise ValueError(f"steps must be at least 1, got {self.steps}")

    @property
    def satellites(self) -> tuple[Satellite, ...]:
        """Names resolved, one for each that is evaluated."""
        return tuple(SATELLITES.values()) if self.satellite == "random" else (SATELLITES[self.satellite],)

    def pool(self) -> SatelliteLike:
        """What episodes draw their satellite from."""
        return [
            s.replace(wheels=s.wheels.replace(max_speed=scale * s.wheels.max_speed))
            for s in self.satellites
            for scale in self.wheel_scales
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return json.loads(json.dumps(dataclasses.asdict(self)))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> TrainSettings:
        """From plain values.

        Raises:
            ValueError: a name is unknown or a value is not valid.
        """
        valid = [f.name for f in dataclasses.fields(cls)]
        for name in values:
            if name not in valid:
                raise unknown_name("training setting", name, valid)
        plain = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        if "reward" in plain:
            plain["reward"] = reward_settings(plain["reward"])
        return cls(**plain)


def named(name: str) -> TrainSettings:
    """Settings kept in agents/settings/NAME.json.

    Raises:
        ValueError: there are none of that name.
    """
    names = sorted(path.stem for path in NAMED.glob("*.json"))
    if name not in names:
        raise unknown_name("training settings", name, names)
    return TrainSettings.from_dict(read_json(NAMED / f"{name}.json", "restore it from the repository"))
