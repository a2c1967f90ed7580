"""Settings of training runs, and the named ones that are kept as data."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

from satid_gym.config import check_number, check_whole, unknown_name
from satid_gym.control.planner import ADAPTIVE_WALK
from satid_gym.files import read_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import check_name
from satid_gym.problem import problem, resolve_satellites
from satid_gym.reward import RewardSettings, reward_settings
from satid_gym.satellite import Satellite
from satid_gym.selection import select_inertias, select_satellites, select_scenario
from satid_gym.sources import is_source

_OWN: dict[str, Callable[[str], Any]] = {
    "satellite": lambda text: select_satellites([text])[0],
    "inertia": lambda text: select_inertias([text])[0],
    "scenario": select_scenario,
}
ANEW = "start the run again, with another --run"  # what to do about a damaged one
NAMED = Path(__file__).parent / "configs"


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a policy learns to fly."""

    name: str = "policy"
    """What tables call the policy."""
    satellite: str = "random"
    """Satellite to train on: a name, a .json or .toml file, or module:name (runs the module's code); "random" draws
    from all three."""
    wheel_scales: tuple[float, ...] = (1.0,)
    """Factors on the wheels' speed limit; each satellite is flown with each (0.1: as in scenario "tight", which
    has that factor already and takes 1 alone)."""
    inertia: str = "random"
    """How the inertia varies: a mode or "random", of randomised laws, or one exact law as a .json, .toml or .csv
    file, or module:name (runs the module's code)."""
    scenario: str = "default"
    """The world to train in: a name, a .json or .toml file, or module:name (runs the module's code)."""
    margin: float = 2.6
    """Of the rate loop, in standard deviations of one decision's noise."""
    hidden: tuple[int, ...] = (64, 64)
    """Layers of the network."""
    seed: int = 0
    """Of environments, network and exploration."""
    evaluation_episodes: int = 32
    """Episodes of an evaluation on validation seeds, on each satellite."""

    def __post_init__(self) -> None:
        check_name(self.name)
        for kind, resolve in _OWN.items():
            text = getattr(self, kind)
            if is_source(text):  # kept in full: a run goes on as it began, whatever becomes of the file
                object.__setattr__(self, kind, json.dumps(resolve(text).to_dict(), sort_keys=True))
        world = problem(self.pool(), self.inertia, self.scenario).scenario  # refuses what is no world
        if world.wheel_speed_scale != 1.0 and set(self.wheel_scales) != {1.0}:
            scales = ", ".join(f"{scale * world.wheel_speed_scale:g}" for scale in self.wheel_scales)
            raise ValueError(
                f"scenario {world.name!r} multiplies the wheels' speed limit by {world.wheel_speed_scale:g} "
                f"already: with wheel_scales {self.wheel_scales} it would be {scales} of nominal; "
                "add --wheel-scales 1, or train in scenario 'default'"
            )

    @property
    def satellites(self) -> tuple[Satellite, ...]:
        """Names resolved, one for each that is evaluated."""
        return resolve_satellites(self.satellite)

    def pool(self) -> list[Satellite]:
        """What episodes draw their satellite from."""
        return [
            s.replace(wheels=s.wheels.replace(max_speed=scale * s.wheels.max_speed))
            for s in self.satellites
            for scale in self.wheel_scales
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain values; what is one's own in full."""
        values = json.loads(json.dumps(dataclasses.asdict(self)))
        return values | {kind: json.loads(values[kind]) for kind in _OWN if values[kind].startswith("{")}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """From plain values.

        Raises:
            ValueError: a name is unknown or a value is not valid.
        """
        valid = [f.name for f in dataclasses.fields(cls)]
        for name in values:
            if name not in valid:
                raise unknown_name("training setting", name, valid)
        plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        plain |= {kind: json.dumps(plain[kind]) for kind in _OWN if isinstance(plain.get(kind), Mapping)}
        return cls(**plain)

    @classmethod
    def of_run(cls, folder: Path) -> Self:
        """Those that the run in a folder was started with.

        Raises:
            ValueError: the folder holds no run, or its settings are damaged.
        """
        if not (folder / "run.json").exists():
            raise ValueError(f"{folder} holds no run to resume")
        head = read_json(folder / "run.json", ANEW, keys=["settings"])
        try:
            settings = cls.from_dict(head["settings"])
        except (TypeError, AttributeError) as error:
            raise ValueError(f"{folder / 'run.json'} holds no settings ({error}): {ANEW}") from error
        missing = sorted({f.name for f in dataclasses.fields(cls)} - set(head["settings"]))
        if missing:
            raise ValueError(f"{folder / 'run.json'} is of another version, without {missing}: {ANEW}")
        return settings


@dataclass(frozen=True, kw_only=True)
class TrainSettings(Task):
    """Everything that decides what a training run learns."""

    name: str = "ppo"
    """What tables call the policy."""
    control: Literal["rate", "torque"] = "rate"
    """What the network commands: body rates through the rate loop, or wheel torque at once."""
    include_covariance: bool = True
    """Whether the network sees the filter's whole covariance."""
    reward: RewardSettings = field(default_factory=lambda: RewardSettings(held_reference=22.0))
    """What pays in training."""
    steps: int = 1_000_000
    """Decisions to train for, all environments together."""
    num_envs: int = 64
    """Environments side by side."""
    rollout: int = 50
    """Decisions of each environment between two updates."""
    batch_size: int = 800
    """Decisions in a minibatch."""
    epochs: int = 5
    """Passes over a rollout."""
    learning_rate: float = 2e-3
    """At the start."""
    final_learning_rate: float = 5e-5
    """At the end; linear between."""
    gamma: float = 0.9
    """Discount."""
    gae_lambda: float = 0.95
    """Of generalised side_value estimation."""
    clip_range: float = 0.2
    """Of PPO's ratio."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    log_std: float = 0.5
    """First logarithm of the exploration's standard deviation."""
    hold: int = 15
    """Decisions for which state-dependent exploration keeps its direction."""
    evaluate_every: int = 200_000
    """Decisions between evaluations on validation seeds."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.num_envs * self.rollout) % self.batch_size:
            raise ValueError(
                f"batch_size must divide num_envs * rollout = {self.num_envs * self.rollout}, got {self.batch_size}"
            )
        if self.steps < 1:
            raise ValueError(f"steps must be at least 1, got {self.steps}")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """From plain values.

        Raises:
            ValueError: a name is unknown or a value is not valid.
        """
        if "reward" in values:
            values = {**values, "reward": reward_settings(values["reward"])}
        return super().from_dict(values)


@dataclass(frozen=True, kw_only=True)
class ImitationSettings(Task):
    """Everything that decides what is learned from model-predictive excitation."""

    name: str = "generalist"
    """What tables call the policy."""
    hidden: tuple[int, ...] = (128, 128)
    """Layers of the network."""
    wheel_scales: tuple[float, ...] = (1.0, 0.1)
    """Factors on the wheels' speed limit; each satellite is flown with each (0.1: as in scenario "tight", which
    has that factor already and takes 1 alone)."""
    margin: float = 2.75
    """Of the rate loop, in standard deviations of one decision's noise."""
    rounds: int = 6
    """Rounds of flights; the teacher flies the first, the network the others."""
    episodes: int = 24
    """Episodes a round on each satellite with each factor on its wheels."""
    taught: float = 0.15
    """Share of the later rounds' episodes that the teacher flies."""
    edits: int = 24
    """Edits of the plan that the teacher tries in each decision."""
    steps: int = 4
    """Steps of the teacher's forecast in each decision."""
    walks: tuple[float, ...] = (ADAPTIVE_WALK, ADAPTIVE_WALK, 0.0003, 0.004)
    """What the teacher plans with where the filter is an AdaptiveEKF, by inertia mode (static, step, drift, periodic):
    random walk of the inertia, per sqrt(s). It is told the mode, the network is not. For a law of one's own it plans
    with the first."""
    epochs: int = 20
    """Passes over all decisions in the last fit."""
    round_epochs: int = 6
    """Passes over them in the fit after any other round."""
    batch_size: int = 1024
    """Decisions in a minibatch."""
    learning_rate: float = 2e-3
    """At the start of a fit; falls linearly to a hundredth."""
    evaluation_episodes: int = 64
    """Episodes of an evaluation on validation seeds, on each satellite."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("rounds", "edits", "steps", "epochs", "round_epochs", "batch_size"):
            check_whole(name, getattr(self, name))
        check_whole("episodes, which are shared among the inertia modes,", self.episodes, low=len(self.modes))
        check_number("taught", self.taught, high=1.0)
        if len(self.walks) != len(INERTIA_MODES):
            raise ValueError(
                f"walks must be {len(INERTIA_MODES)} numbers, one for each of {INERTIA_MODES}, got {self.walks}"
            )
        for walk in self.walks:
            check_number("walks", walk)

    @property
    def modes(self) -> tuple[str, ...]:
        """Inertia modes that are flown."""
        return INERTIA_MODES if self.inertia == "random" else (self.inertia,)


def named(name: str) -> TrainSettings:
    """Settings kept in agents/training/configs/NAME.json.

    Raises:
        ValueError: there are none of that name.
    """
    names = sorted(path.stem for path in NAMED.glob("*.json"))
    if name not in names:
        raise unknown_name("training settings", name, names)
    return TrainSettings.from_dict(read_json(NAMED / f"{name}.json", "restore it from the repository"))
