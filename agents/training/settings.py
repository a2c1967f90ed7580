"""Settings of training runs: what every algorithm has, and what reinforcement learning has in addition."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from satid_gym.config import Config, check_integer, check_number
from satid_gym.core.observation import Form
from satid_gym.drawn_satellite import draw_satellites
from satid_gym.evaluation import SPLIT_SIZE, seeds
from satid_gym.files import DamagedFileError, read_json
from satid_gym.policies.learned import Network
from satid_gym.policies.learned.policy import LearnedPolicy, check_name
from satid_gym.problem import problem
from satid_gym.resolution import resolve_satellites
from satid_gym.reward import RewardSettings, reward_settings
from satid_gym.satellite import Satellite
from satid_gym.selection import select_inertias, select_satellites, select_scenario
from satid_gym.sources import is_source

_OWN: dict[str, Callable[[str], Any]] = {
    "satellite": lambda text: select_satellites([text])[0],
    "inertia": lambda text: select_inertias([text])[0],
    "scenario": select_scenario,
}
DRAWN = "drawn"  # satellites, see `satid_gym.drawn_satellite`
_DRAWN_EVALUATED = 24
RESTART = "start the run again, with another --run"  # what to do about a damaged one


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(Config):
    """What a policy learns to fly.

    Attributes:
        algorithm: that learns it.
    """

    algorithm: ClassVar[str]

    name: str = "policy"
    """What tables call the policy."""
    satellite: str = "random"
    """Satellite to train on: a name, a .json or .toml file, or module:name (runs the module's code); "random" draws
    from the three of the benchmark, "drawn" from `drawn` random satellites."""
    drawn: int = 512
    """Satellites of `satid_gym.draw_satellites` that "drawn" trains on, drawn with training seeds."""
    drawn_wheels: int = 4
    """Wheels of each of these: one environment has one number of them."""
    wheel_scales: tuple[float, ...] = (1.0,)
    """Factors on the wheels' speed limit; each satellite is flown with each (0.1: as in scenario "tight", which
    has that factor already and takes 1 alone)."""
    inertia: str = "random"
    """How the inertia varies: a mode or "random", of randomised laws, or one exact law as a .json, .toml or .csv
    file, or module:name (runs the module's code)."""
    scenario: str = "default"
    """The world to train in: a name, a .json or .toml file, or module:name (runs the module's code)."""
    margin: float = 2.6
    """Margin of the rate loop, in standard deviations of one decision's noise."""
    hidden: tuple[int, ...] = (64, 64)
    """Layers of the network."""
    seed: int = 0
    """Seed of environments, network and exploration."""
    evaluation_episodes: int = 32
    """Episodes of an evaluation on validation seeds, on each satellite."""
    judged_by: Literal["errors", "reward"] = "errors"
    """What chooses among a run's policies, on validation seeds: final and mean error, times the excess of the cost over
    1 %; or the reward, where an unknown unit that no excitation finds is most of the errors ("calibration")."""

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            object.__setattr__(self, f.name, self._from_json(f.name, getattr(self, f.name)))
        super().__post_init__()
        check_name(self.name)
        check_number("margin", self.margin)
        check_integer("seed", self.seed, low=0)
        check_integer("evaluation_episodes", self.evaluation_episodes)
        if not self.hidden:
            raise ValueError("hidden must name the units of at least one layer, such as --hidden 64 64, got none")
        for units in self.hidden:
            check_integer("hidden", units)
        world = problem(self.pool(), self.inertia, self.scenario).scenario  # refuses what is no world
        if world.wheel_speed_scale != 1.0 and set(self.wheel_scales) != {1.0}:
            scales = ", ".join(f"{scale * world.wheel_speed_scale:g}" for scale in self.wheel_scales)
            raise ValueError(
                f"scenario {world.name!r} multiplies the wheels' speed limit by {world.wheel_speed_scale:g} "
                f"already: with wheel_scales {self.wheel_scales} it would be {scales} of nominal; "
                "add --wheel-scales 1, or train in scenario 'default'"
            )

    @staticmethod
    def _from_json(name: str, value: Any) -> Any:
        """A field's value; a custom definition becomes text that no longer depends on its file."""
        if isinstance(value, list):
            return tuple(value)
        if name in _OWN and isinstance(value, Mapping):
            value = json.dumps(value)
        if name in _OWN and is_source(value):
            return json.dumps(_OWN[name](value).to_dict(), sort_keys=True)
        return value

    @property
    def satellites(self) -> tuple[Satellite, ...]:
        """Names resolved, one for each that is evaluated; drawn ones are of validation seeds."""
        if self.satellite == DRAWN:
            return draw_satellites(seeds("validation", _DRAWN_EVALUATED), wheels=self.drawn_wheels)
        return resolve_satellites(self.satellite)

    def pool(self) -> list[Satellite]:
        """What episodes draw their satellite from."""
        return [
            s.replace(wheels=s.wheels.replace(max_speed=scale * s.wheels.max_speed))
            for s in self._trained_on()
            for scale in self.wheel_scales
        ]

    def _trained_on(self) -> tuple[Satellite, ...]:
        if self.satellite == DRAWN:
            return draw_satellites(seeds("training", self.drawn), wheels=self.drawn_wheels)
        return self.satellites

    @property
    def actions(self) -> str:
        """What actions of the environment are, its `control`."""
        return "torque"

    def to_dict(self) -> dict[str, Any]:
        """Plain values; custom definitions in full."""
        values = super().to_dict()
        return values | {kind: json.loads(values[kind]) for kind in _OWN if values[kind].startswith("{")}

    @classmethod
    def of_run(cls, folder: Path) -> Self:
        """Those that the run in a folder was started with.

        Raises:
            ValueError: the folder holds no run, or its settings are damaged.
        """
        path = folder / "run.json"
        values = head_of(folder)["settings"]
        try:
            settings = cls.from_dict(values)
        except ValueError as error:
            raise DamagedFileError(f"{path} holds no settings ({error}): {RESTART}") from error
        missing = sorted({f.name for f in dataclasses.fields(cls)} - set(values))
        if missing:
            raise DamagedFileError(f"{path} is of another version, without {missing}: {RESTART}")
        return settings


def head_of(folder: Path) -> dict[str, Any]:
    """What a run's folder says of how it was started.

    Raises:
        ValueError: the folder holds no run, or its run.json is damaged.
    """
    if not (folder / "run.json").exists():
        raise ValueError(f"{folder} holds no run to resume")
    return read_json(folder / "run.json", RESTART, keys=["settings"])


@dataclass(frozen=True, eq=False, kw_only=True)
class RLSettings(Task):
    """What reinforcement learning has in addition, whatever the algorithm."""

    control: Literal["rate", "torque"] = "rate"
    """What the network commands: body rates through a rate loop, or wheel torque at once."""
    tracked: bool = False
    """Whether the environment's own rate loop flies the rates, with every sample (its `control="rate"`); without, the
    policy's once a decision."""
    observation: Form = "wheels"
    """What the network sees of the wheels: each one, or what they do to the "body", with the modes of panels and
    tanks; that one goes with `tracked`."""
    spares_modes: bool = False
    """Whether commands are changed so that panels and tanks stay inside their limit; goes with `tracked` and "body"."""
    switches: bool = False
    """Whether the network says to which side to turn at full rate, or to rest, see `agents.training.sb3.switches`; for
    PPO and control rate."""
    reversals: bool = False
    """Whether these switches say for each axis to reverse, and not to which side; for rates that are `tracked`."""
    repeat: int = 1
    """Decisions for which a command is repeated; more than one goes with switches."""
    include_covariance: bool = True
    """Whether the network sees the filter's whole covariance."""
    include_walk: bool = False
    """Whether it sees the random walk of the inertia that the filter uses."""
    reward: RewardSettings = field(default_factory=lambda: RewardSettings(held_reference=22.0))
    """What pays in training."""
    steps: int = 1_000_000
    """Commands to train for, all environments together; each is of `repeat` decisions."""
    num_envs: int = 64
    """Environments side by side."""
    batch_size: int = 800
    """Commands in a minibatch."""
    gamma: float = 0.9
    """Discount from a command to the next."""
    evaluate_every: int = 200_000
    """Commands between evaluations on validation seeds."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "reward", reward_settings(self.reward))
        super().__post_init__()
        if self.tracked and self.control != "rate":
            raise ValueError("--tracked needs --control rate")
        if self.observation == "body" and self.control == "rate" and not self.tracked:
            raise ValueError("the policy's own rate loop needs the speed of each wheel: add --tracked for body")
        if self.spares_modes and not (self.tracked and self.observation == "body"):
            raise ValueError("modes are spared where they are observed: add --tracked --observation body")
        if self.switches and (self.control != "rate" or self.algorithm != "ppo"):
            raise ValueError("--switches needs --control rate and PPO")
        if self.reversals and not (self.switches and self.tracked):
            raise ValueError("reversals need the command in the observation: add --switches --tracked")
        if self.repeat > 1 and not self.switches:
            raise ValueError("commands are repeated where they are switches: add --switches, or leave repeat at 1")
        for name in ("repeat", "steps", "num_envs", "batch_size", "evaluate_every"):
            check_integer(name, getattr(self, name))
        check_number("gamma", self.gamma, high=1.0)
        check_integer("seed", self.seed, low=0, high=SPLIT_SIZE // self.num_envs - 1)  # each has seeds of its own

    @property
    def actions(self) -> str:
        """What actions of the environment are, its `control`."""
        return "rate" if self.tracked else "torque"


def policy_of(network: Network, settings: RLSettings) -> LearnedPolicy:
    """The network as a policy that flies as it was trained."""
    s = settings
    return LearnedPolicy(
        s.name,
        network,
        s.control,
        s.margin,
        s.include_covariance,
        observation=s.observation,
        include_walk=s.include_walk,
        repeat=s.repeat,
        spares_modes=s.spares_modes,
    )
