"""Settings of an evolution of the score of corners."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from satid_gym.config import check_integer, check_names, check_number
from satid_gym.control.corners.features import FEATURES, features_of, takes_band, takes_stars, takes_walk, takes_windows
from satid_gym.control.gaps import SETTLE
from satid_gym.drawn_satellite import draw_satellites
from satid_gym.evaluation import Split, seeds
from satid_gym.policies.learned import Network
from satid_gym.policies.learned.policy import LearnedPolicy, check_name
from satid_gym.policies.learned.shipped import find
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS

_COSTS = {"band_crossing": -5.0, "band_stay": -2.0}  # first weights of what a tour that knows no band leaves out


@dataclass(frozen=True, kw_only=True)
class Evolution:
    """Settings of a run."""

    name: str = "tank_tour"
    """What tables call the policy."""
    scenarios: tuple[str, ...] = ("slosh",)
    """Scenarios that are flown, each counting as much; all with a star tracker or none, and so with imaging
    windows and a band of wheel speed."""
    horizon: float | None = None
    """s that an episode of training lasts. Default: each scenario's."""
    satellites: tuple[str, ...] = ("cubesat", "microsat", "smallsat")
    """Satellites that fly, the same policy on all; or ("drawn",): as many as `drawn` of any kind."""
    drawn: int = 256
    """Satellites of `satid_gym.draw_satellites` that "drawn" stands for, drawn with tuning seeds."""
    drawn_wheels: int = 4
    """Wheels of each of these."""
    generations: int = 80
    """Generations to evolve for."""
    averaged: int = 20
    """Last generations of which the policy is the mean."""
    population: int = 14
    """Sets of weights in a generation."""
    episodes: int = 63
    """Episodes of each scenario that judge each of them, the same for all of a generation."""
    start: str | None = None
    """Tour whose weights are the first, by name or path. Default: 1 for the waits, `gain` for what a turn tells."""
    gain: float = 1.0
    """First weight of what a turn tells, where no tour is given to start from."""
    step: float = 0.15
    """First standard deviation of the weights."""
    price: float = 5.0
    """Log of the error that each share of an episode beyond a limit costs, beyond the first 0.5 %."""
    margin: float = 3.5
    """Margin of the rates, see `satid_gym.control.rate_loop.RateMargin`."""
    settle: float = SETTLE
    """s before an imaging window opens at which the target is to be held."""
    shaped: bool = False
    """Whether a decision goes towards its corner as far as modes allow, see `satid_gym.control.mode_shaping`."""
    seed: int = 0
    """Seed of the evolution."""
    workers: int = 2
    """Threads that fly weights side by side."""
    validation: int = 24
    """Episodes of each cell that judge the result, validation seeds."""
    ship: bool = False
    """Save the policy among the shipped ones too."""
    output: Path | None = None
    """Folder of the run. Default: runs/NAME-SEED."""

    def __post_init__(self) -> None:
        check_names("scenario", self.scenarios, SCENARIOS)
        if not self.is_drawn:
            check_names("satellite", self.satellites, SATELLITES)
        check_name(self.name)
        for name in ("generations", "averaged", "episodes", "workers", "validation", "drawn", "drawn_wheels"):
            check_integer(name, getattr(self, name))
        check_integer("population", self.population, low=4)
        check_integer("seed", self.seed, low=0)
        check_number("gain", self.gain)
        check_number("price", self.price)
        check_number("step", self.step, strict=True)
        check_number("settle", self.settle)
        if self.start is not None and not find(self.start).corner_features:
            raise ValueError(f"start must be a policy that scores corners, such as rigid_tour; {self.start} does not")
        if self.shaped and all(SCENARIOS[name].appendages is None for name in self.scenarios):
            raise ValueError(f"no panels or tanks to spare in {', '.join(self.scenarios)}: leave out --shaped")
        kinds = {"a star tracker": takes_stars, "imaging windows": takes_windows, "a band of wheel speed": takes_band}
        for what, takes in kinds.items():
            lacking = [world.name for world in self.worlds if not takes(features_of(world, self.shaped))]
            if lacking and takes(self.features):
                raise ValueError(
                    f"scenarios must all have {what} or none, because the score takes it; {', '.join(lacking)} has "
                    "none: evolve a policy for each kind"
                )
        if self.horizon is not None:
            check_number("horizon", self.horizon, strict=True)

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return self.output or Path("runs") / f"{self.name}-{self.seed}"

    @property
    def worlds(self) -> tuple[Scenario, ...]:
        """Scenarios of training."""
        worlds = (SCENARIOS[name] for name in self.scenarios)
        return tuple(world if self.horizon is None else world.replace(horizon=self.horizon) for world in worlds)

    @property
    def first(self) -> np.ndarray:
        """(features,) weights to begin with."""
        if self.start is None:
            weights = {"waited": 1.0, "gain": self.gain}
        else:
            tour = find(self.start)
            weights = dict(zip(tour.corner_features, tour.network.weights[0][0].tolist(), strict=True))
        return np.array([weights.get(name, _COSTS.get(name, 0.0)) for name in self.features])

    @property
    def is_drawn(self) -> bool:
        """Whether the satellites are drawn at random."""
        return tuple(self.satellites) == ("drawn",)

    def flies(self, split: Split, count: int) -> list[str | Satellite]:
        """Satellites: by name, or `count` drawn with seeds of a split."""
        if self.is_drawn:
            return list(draw_satellites(seeds(split, count), wheels=self.drawn_wheels))
        return list(self.satellites)

    @property
    def features(self) -> tuple[str, ...]:
        """What the score takes: the features of all scenarios together."""
        found = {name for world in self.worlds for name in features_of(world, self.shaped)}
        return tuple(name for name in FEATURES if name in found)

    def policy(self, weights: np.ndarray, **details: Any) -> LearnedPolicy:
        """Policy of some weights (features,)."""
        network = Network((weights[None].astype(np.float32),), (np.zeros(1, np.float32),))
        return LearnedPolicy(
            self.name,
            network,
            "rate",
            self.margin,
            details=details,
            observation="body",
            corner_features=self.features,
            settle=self.settle,
            include_covariance=True,
            include_walk=takes_walk(self.features),
            is_shaped=self.shaped,
        )
