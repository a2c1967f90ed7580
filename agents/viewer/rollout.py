"""Rollout of one policy in one environment with its history so far, and the pairing of two for the viewers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import tyro

from agents.benchmark.entrants import entrant
from baselines.command.options import ScenarioText
from baselines.scenarios.flights import unit_free_error
from baselines.tuning.by_rates import all_baselines
from baselines.tuning.prepared import Prepared
from satid_gym.commands.ending import early_end
from satid_gym.config import check_number
from satid_gym.env import SatInertiaIDEnv
from satid_gym.evaluation import FIRST_SEED, benchmark_scenario
from satid_gym.laws import INERTIA_MODES, MASS_MODES
from satid_gym.policy import Policy, observation_settings, only_mission, show_filter
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.selection import label, select_inertias, select_satellites, select_scenario

_MODES = ("random", *INERTIA_MODES, *MASS_MODES)


class Rollout:
    """One episode of one policy, flown decision by decision.

    Args:
        policy: the policy that decides.
        env: an environment of one satellite with the observation that the policy takes; it is reset here.
        seed: of the episode; rollouts with the same seed and settings have the same truth and noise.

    Attributes:
        info: of the last decision.
        over: whether the episode has ended.
        terminated: whether it ended early, far outside the limits of rates or deflections.
        ending: time and cause of an early end, else empty.
        history: by name, one entry at the start and one per decision: relative_error, in units of the rotors' inertia
            where that is not known exactly; measured rate and wheel_speed over their limits; std, the filter's
            standard deviation of each moment relative to its prior; outside, share of the time; information, gained
            since the start, nats.
    """

    def __init__(self, policy: Policy, env: SatInertiaIDEnv, seed: int) -> None:
        self.policy, self.env = policy, env
        policy.reset(only_mission(env.problem), [seed])
        self._observation, self.info = env.reset(seed=seed)
        self.over, self.terminated, self.ending = False, False, ""
        self.history: dict[str, list] = {
            name: [] for name in ("relative_error", "rate", "wheel_speed", "std", "outside", "information")
        }
        self._note()

    def step(self) -> None:
        """Take a decision; no effect after the end of the episode."""
        if self.over:
            return
        rows = self.env.fleet.rows
        show_filter(self.policy, rows.beliefs, rows.tasks)
        action = self.policy(self._observation[None])[0]
        self._observation, _, self.terminated, truncated, self.info = self.env.step(action)
        self.over = self.terminated or truncated
        self.ending = early_end(self.env) if self.terminated else ""
        self._note()

    def picture(self) -> np.ndarray:
        """Frame (height, width, 3), uint8, of the present moment; the environment draws "rgb_array"."""
        frame = self.env.render()
        assert frame is not None
        return frame

    def _note(self) -> None:
        layout, information, rows = self.env.layout, self.history["information"], self.env.fleet.rows
        self.history["relative_error"].append(float(unit_free_error(self.env.fleet)[0]))
        self.history["rate"].append(self._observation[layout["rate"]].copy())
        if "wheel_speed" in layout:
            self.history["wheel_speed"].append(self._observation[layout["wheel_speed"]].copy())
        else:
            self.history["wheel_speed"].append(rows.beliefs["speed"][0] / rows.tasks["wheel_speed_max"][0])
        self.history["std"].append(10.0 ** (self._observation[layout["uncertainty"]][:3].astype(float) - 2.0))
        self.history["outside"].append(self.info["outside"])
        information.append((information[-1] if information else 0.0) + self.info["information_gain"])

    @property
    def name(self) -> str:
        """Name of the policy."""
        return self.policy.name

    @property
    def error(self) -> float:
        """Present relative error of the inertia."""
        return self.history["relative_error"][-1]

    @property
    def mean_error(self) -> float:
        """Mean relative error over the episode so far, without the start."""
        return float(np.mean(self.history["relative_error"][1:] or [self.error]))

    @property
    def outside(self) -> float:
        """Share of the time so far with a rate outside its limit."""
        return float(np.mean(self.history["outside"][1:] or [0.0]))


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """Two policies and the episode that both fly, with the same truth and noise."""

    policy: tyro.conf.Positional[str]
    """Policy: a shipped policy's name, a baseline, the path of a policy's files or of a run's folder, module:name (runs
    the module's code), or NAME= before either of the two."""
    against: str = "multi_step"
    """Second policy, shown next to the first; given in the same way."""
    satellite: str = "microsat"
    """Satellite to fly: a name, a .json or .toml file, or module:name (runs the module's code)."""
    inertia: str = "step"
    """Variation of its inertia: static, step, drift, periodic, random, deployment, fuel, release, a law as a .json,
    .toml or .csv file, or module:name (runs the module's code)."""
    scenario: ScenarioText = "default"
    """Scenario: a name, a .json or .toml file, or module:name (runs the module's code)."""
    control: Literal["torque", "rate"] = "torque"
    """What policies command: wheel torque, or body rates, by which scenarios are flown in the standing table. Baselines
    then have the settings of that table."""
    horizon: float | None = None
    """Length of the episode, s; that of the scenario if not given."""
    seed: int = FIRST_SEED["validation"]
    """Seed of the episode."""
    prepared: Annotated[Prepared, tyro.conf.arg(name="")] = field(default_factory=Prepared)

    @property
    def title(self) -> str:
        """Title of the episode: satellite and inertia mode."""
        (satellite,), (inertia,) = select_satellites([self.satellite]), select_inertias([self.inertia], _MODES)
        return f"{satellite.name}, {label(inertia)} inertia"

    def rollouts(self, render_mode: str | None = None, render_size: int = 480) -> tuple[Rollout, Rollout]:
        """Rollouts of both policies, at the start of the episode.

        Raises:
            ValueError: a name is unknown, a file's content or a number is not valid, a baseline is not tuned for
                this satellite and scenario, a learned policy was trained for another observation, or two different
                policies have the same name.
        """
        (satellite,), (inertia,) = select_satellites([self.satellite]), select_inertias([self.inertia], _MODES)
        scenario = select_scenario(self.scenario)
        check_number("seed", self.seed)
        world = benchmark_scenario(scenario)
        if self.horizon is not None:
            world = world.replace(horizon=self.horizon)
        place = (self.scenario, scenario)
        self.prepared.check([(self.satellite, satellite)], [place])
        policies = [self._policy(text, satellite, place) for text in (self.policy, self.against)]
        if policies[0].name == policies[1].name and self.policy != self.against:
            raise ValueError(
                f"both policies have the name {policies[0].name!r}: tell them apart by NAME=PATH, "
                f"say other={self.against.rpartition('=')[2]}"
            )
        first, second = (
            Rollout(
                policy,
                SatInertiaIDEnv(
                    satellite,
                    inertia,
                    world,
                    render_mode=render_mode,
                    render_size=render_size,
                    control=self.control,
                    **observation_settings(policy),
                ),
                self.seed,
            )
            for policy in policies
        )
        return first, second

    def _policy(self, text: str, satellite: Satellite, place: tuple[str, Scenario]) -> Policy:
        """A baseline with its settings for what it commands here, or another policy."""
        if text in all_baselines(place[1], self.control):
            return self.prepared.policy(text, satellite, place, [(self.satellite, satellite)], self.control)
        return entrant(text)
