"""Flights as Minari data sets for learning offline: `python -m agents.dataset`.

    python -m agents.dataset --policies mpc generalist ppo chirp
    python -m agents.dataset --policies generalist --control rate    what python -m agents.imitate --data takes

One data set for each policy, named NAMESPACE/POLICY-v0, in Minari's folder (MINARI_DATASETS_PATH). Every policy flies
the same episodes, on seeds of the training split. An episode has observations, actions, rewards and ends; its infos
have costs by name, the truth and the filter's estimate; with its seed and options `reset` of the recovered environment
begins it again.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import gymnasium
import tyro
from gymnasium.envs.registration import EnvSpec
from tqdm import tqdm

from agents.benchmark.entrants import entrant
from agents.dataset import storage
from agents.dataset.flights import record
from baselines.command import cli
from baselines.command.options import ScenarioText
from baselines.command.provenance import result_head
from baselines.tuning.by_rates import all_baselines
from baselines.tuning.prepared import Prepared
from satid_gym import metrics
from satid_gym.config import check_integer
from satid_gym.evaluation import seeds
from satid_gym.laws import INERTIA_MODES
from satid_gym.policy import Policy, observation_settings
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES, Satellite
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.selection import label, select_inertias, select_satellites, select_scenario


@dataclass(frozen=True, kw_only=True)
class Collection:
    """What to fly, and where it goes."""

    policies: tuple[str, ...] = ("generalist",)
    """Policies to fly: names of baselines and shipped ones, paths of a policy's files or of a run's folder,
    module:name (runs the module's code), or NAME= before either of the two."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly: names, .json or .toml files, or module:name (runs the module's code)."""
    modes: tuple[str, ...] = INERTIA_MODES
    """How their inertia varies: modes, laws as .json, .toml or .csv files, or module:name (runs the module's code)."""
    scenario: ScenarioText = "default"
    """The world: a name, a .json or .toml file, or module:name (runs the module's code)."""
    control: Literal["torque", "rate"] = "torque"
    """What actions are: torque of each wheel, or body rates."""
    include_covariance: bool = True
    """Whether observations are recorded with the filter's whole covariance; policies see what they ask for."""
    episodes: int = 25
    """Episodes of each policy on each satellite with each inertia mode."""
    skip: int = 0
    """Seeds of the training split to pass over."""
    namespace: str = "satid"
    """Minari's namespace of the data sets."""
    prepared: Annotated[Prepared, tyro.conf.arg(name="")] = field(default_factory=Prepared)

    def check(self) -> None:
        """Refuse invalid numbers.

        Raises:
            ValueError: episodes or skip is not an integer that counts.
        """
        check_integer("episodes", self.episodes)
        check_integer("skip", self.skip, low=0)

    def named(self, policy: str) -> str:
        """Minari's name of a policy's data set."""
        return f"{self.namespace}/{policy}-v0"


def collect(collection: Collection) -> list[str]:
    """Fly and write everything; the data sets' names.

    Raises:
        ValueError: a name is unknown, a policy cannot fly there, or there is a data set of its name.
        UserError: Minari is not installed.
    """
    satellites = select_satellites(collection.satellites)
    teams = {
        text: [policy_for(collection, text, satellite) for satellite in satellites] for text in collection.policies
    }
    names = [collection.named(team[0].name) for team in teams.values()]
    for name in names:
        storage.check_free(name)
    for name, team in zip(names, teams.values(), strict=True):
        _write(collection, name, satellites, team)
    return names


def policy_for(collection: Collection, text: str, satellite: Satellite) -> Policy:
    """A policy for a satellite, by what it was named."""
    place = collection.scenario, select_scenario(collection.scenario)
    if text in all_baselines(place[1], collection.control):
        flown = list(zip(collection.satellites, select_satellites(collection.satellites), strict=True))
        return collection.prepared.policy(text, satellite, place, flown, collection.control)
    return entrant(text)


def _write(collection: Collection, name: str, satellites: Sequence[Satellite], team: Sequence[Policy]) -> None:
    """Fly one policy, made for each satellite, and write its data set."""
    scenario, modes = select_scenario(collection.scenario), select_inertias(collection.modes)
    covariance = collection.include_covariance
    environment: dict[str, Any] = {
        "satellite": [s.name if SATELLITES.get(s.name) == s else s.to_dict() for s in satellites],
        "inertia": "random" if len(modes) > 1 else modes[0] if isinstance(modes[0], str) else modes[0].to_dict(),
        "scenario": scenario.name if SCENARIOS.get(scenario.name) == scenario else scenario.to_dict(),
        "control": collection.control,
        **observation_settings(team[0]),
    }
    environment["include_covariance"] |= covariance
    chosen = seeds("training", collection.episodes * len(satellites) * len(modes), collection.skip)
    cells = [(satellite, policy, mode) for satellite, policy in zip(satellites, team, strict=True) for mode in modes]
    start = time.perf_counter()
    scores: list[tuple[float, float]] = []

    def flown() -> Iterator[storage.Flown]:
        for i, (satellite, policy, mode) in enumerate(tqdm(cells, desc=policy_name, unit="cell", leave=False)):
            episodes = record(
                policy,
                satellite=satellite,
                inertia=mode,
                scenario=scenario,
                control=collection.control,
                seeds=chosen[i * collection.episodes : (i + 1) * collection.episodes],
                include_covariance=covariance,
            )
            scores.extend((episode.rewards.sum(), _final_error(episode)) for episode in episodes)
            yield {"satellite": satellite.name, "inertia": label(mode)}, episodes

    policy_name = team[0].name
    head = {
        **result_head("agents.dataset", split="training", seeds=chosen),
        "policy": {
            "name": policy_name,
            "kind": team[0].kind,
            "trained": getattr(team[0], "details", {}).get("trained"),
        },
        "environment": environment,
    }
    spec = gymnasium.spec("SatInertiaID-v0")
    dataset = storage.write(name, _with(spec, environment), head, policy_name, flown())
    rewards, errors = (sum(values) / len(scores) for values in zip(*scores, strict=True))
    print(
        f"{name}: {dataset.total_episodes} episodes, {dataset.total_steps} decisions, mean return {rewards:.1f}, "
        f"final error {errors:.4%}, {time.perf_counter() - start:.0f} s"
    )


def _with(spec: EnvSpec, environment: dict[str, Any]) -> EnvSpec:
    """The environment's specification with settings of its own."""
    return EnvSpec(id=spec.id, entry_point=spec.entry_point, kwargs=environment)


def _final_error(episode: Any) -> float:
    """Relative error over the last 20 % of the decisions."""
    return float(metrics.final_error(episode.infos["relative_error"][1:, None])[0])


def main(collection: Collection) -> None:
    """Command line."""
    with cli.user_errors():
        collect(collection)
