"""A policy at the controls of one environment of its own, and what it has done so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import tyro

from agents.cast import Prepared, learned
from baselines import BASELINES
from satid_gym.config import check_number
from satid_gym.env import SatInertiaIDEnv
from satid_gym.evaluation import FIRST_SEED, benchmark_scenario
from satid_gym.laws import INERTIA_MODES
from satid_gym.policy import Policy, includes_covariance, missions
from satid_gym.selection import label, select_inertias, select_satellites, select_scenario

_MODES = ("random", *INERTIA_MODES)


class Pilot:
    """Flies one episode, decision by decision.

    Args:
        policy: what decides.
        env: its own, with one satellite and the observation that the policy takes; it is reset here.
        seed: of the episode: pilots with the same seed and settings meet the same truth and noise.

    Attributes:
        info: of the last decision.
        over: whether the episode has ended.
        terminated: whether it ended early, far outside the rate limits.
        history: by name, one entry at the start and one a decision: relative_error; rate and wheel_speed
            over their limits, as measured; std, the filter's standard deviation of each moment, relative to
            its prior; cost; information, gained since the start.
    """

    def __init__(self, policy: Policy, env: SatInertiaIDEnv, seed: int) -> None:
        self.policy, self.env = policy, env
        (mission,) = missions(env.problem)
        policy.reset(mission, [seed])
        self._observation, self.info = env.reset(seed=seed)
        self.over = self.terminated = False
        self.history: dict[str, list] = {
            name: [] for name in ("relative_error", "rate", "wheel_speed", "std", "outside", "information")
        }
        self._note()

    def step(self) -> None:
        """Take a decision; nothing happens once the episode is over."""
        if self.over:
            return
        action = self.policy(self._observation[None])[0]
        self._observation, _, self.terminated, truncated, self.info = self.env.step(action)
        self.over = self.terminated or truncated
        self._note()

    def _note(self) -> None:
        places, gained = self.env.layout, self.history["information"]
        self.history["relative_error"].append(self.info["relative_error"])
        for name in ("rate", "wheel_speed"):
            self.history[name].append(self._observation[places[name]].copy())
        self.history["std"].append(10.0 ** (self._observation[places["uncertainty"]][:3].astype(float) - 2.0))
        self.history["outside"].append(self.info["outside"])
        gained.append((gained[-1] if gained else 0.0) + self.info["information_gain"])

    @property
    def name(self) -> str:
        """The policy's."""
        return self.policy.name

    @property
    def error(self) -> float:
        """Relative error of the inertia now."""
        return float(self.info["relative_error"])

    @property
    def mean_error(self) -> float:
        """Its mean over the episode so far, leaving out the start."""
        return float(np.mean(self.history["relative_error"][1:] or [self.error]))

    @property
    def outside(self) -> float:
        """Share of the time so far with a rate outside its limit."""
        return float(np.mean(self.history["outside"][1:] or [0.0]))


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """Which two policies fly which episode; truth and noise are the same for both."""

    policy: tyro.conf.Positional[str]
    """A shipped policy's name, a baseline, the path of a policy's files or of a run's folder, or NAME=PATH."""
    beside: Annotated[str, tyro.conf.arg(aliases=("--profile",))] = "multi_step"
    """The same, to fly beside it."""
    satellite: str = "microsat"
    """Satellite to fly: a name, a .json or .toml file, or module:name (runs the module's code)."""
    inertia: str = "step"
    """How its inertia varies: static, step, drift, periodic, random, a law as a .json, .toml or .csv file, or
    module:name (runs the module's code)."""
    scenario: str = "default"
    """The world: default, tight, paper or faults, a .json or .toml file, or module:name (runs the module's code)."""
    horizon: float = 300.0
    """Length of the episode, s."""
    seed: int = FIRST_SEED["validation"]
    """Seed of the episode."""
    prepared: Annotated[Prepared, tyro.conf.arg(name="")] = field(default_factory=Prepared)

    @property
    def title(self) -> str:
        """Satellite and inertia mode in words."""
        (satellite,), (inertia,) = select_satellites([self.satellite]), select_inertias([self.inertia], _MODES)
        return f"{satellite.name}, {label(inertia)} inertia"

    def pilots(self, render_mode: str | None = None, render_size: int = 480) -> tuple[Pilot, Pilot]:
        """Both at the start of the episode.

        Raises:
            ValueError: a name is unknown, what a file holds or a number is not valid, a baseline is not tuned for
                this satellite and scenario, a learned policy was trained for another observation, or two different
                policies have one name.
        """
        (satellite,), (inertia,) = select_satellites([self.satellite]), select_inertias([self.inertia], _MODES)
        scenario = select_scenario(self.scenario)
        check_number("seed", self.seed)
        world = benchmark_scenario(scenario).replace(horizon=self.horizon)
        craft, place = (self.satellite, satellite), (self.scenario, scenario)
        self.prepared.check([craft], [place])
        texts = (self.policy, self.beside)
        policies = [self.prepared.policy(t, satellite, place, [craft]) if t in BASELINES else learned(t) for t in texts]
        if policies[0].name == policies[1].name and self.policy != self.beside:
            raise ValueError(
                f"both policies have the name {policies[0].name!r}: tell them apart by NAME=PATH, "
                f"say other={self.beside.rpartition('=')[2]}"
            )
        first, second = (
            Pilot(
                policy,
                SatInertiaIDEnv(
                    satellite,
                    inertia,
                    world,
                    render_mode=render_mode,
                    render_size=render_size,
                    include_covariance=includes_covariance(policy),
                ),
                self.seed,
            )
            for policy in policies
        )
        return first, second
