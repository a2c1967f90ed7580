"""Scores of one policy: `python -m agents.evaluate POLICY`, a shipped name, the path of its files or module:name.

Validation seeds by default: the test seeds are for the comparison.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from agents.benchmark.compare import Comparison, compare
from agents.benchmark.entrants import entrant
from agents.benchmark.summary.tables import print_comparison
from baselines.command import cli
from baselines.command.options import ScenarioText
from baselines.tuning.prepared import Prepared
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.open_loop_optimal import NotPreparedError
from satid_gym.satellite import BENCHMARK_SATELLITES


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What to fly."""

    policy: tyro.conf.Positional[str]
    """A shipped policy's name, the path of a policy's files or of a run's folder, module:name (runs the module's
    code), or NAME= before either of the two."""
    against: tuple[str, ...] = ("rate_square",)
    """Baselines to fly next to it."""
    scenario: ScenarioText = "default"
    """The world: a name, a .json or .toml file, or module:name (runs the module's code)."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly: names, .json or .toml files, or module:name (runs the module's code)."""
    modes: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["--inertias"])] = INERTIA_MODES
    """How their inertia varies: modes, laws as .json, .toml or .csv files, or module:name (runs the module's code)."""
    episodes: int = 100
    """Episodes of each policy in each cell."""
    seed_split: Annotated[str, tyro.conf.arg(aliases=["--split"])] = "validation"
    """Which seeds: training, tuning, validation or test."""
    control: Literal["torque", "rate"] = "torque"
    """What actions are: torque of each wheel, or body rates."""
    prepared: Annotated[Prepared, tyro.conf.arg(name="")] = field(default_factory=Prepared)

    @property
    def comparison(self) -> Comparison:
        """The flights of the policy and those next to it."""
        return Comparison(
            scenario=self.scenario,
            satellites=self.satellites,
            modes=self.modes,
            control=self.control,
            policies=(self.policy, *self.against),
            episodes=self.episodes,
            seed_split=self.seed_split,
            prepared=self.prepared,
        )


def main(evaluation: Evaluation) -> int:
    """Fly the policy and print its tables; the exit code."""
    with cli.user_errors():
        entrant(evaluation.policy)  # refuses a baseline
        comparison = evaluation.comparison
        try:
            entrants = comparison.entrants()
        except NotPreparedError as error:  # of a baseline next to it, maybe the default one
            raise NotPreparedError(f"{error}; or fly another next to it, such as --against zero") from error
    results = compare(comparison, entrants)
    split, first = results["seeds"]["split"], results["seeds"]["first"]
    head = f"{evaluation.policy}: {comparison.episodes} episodes a cell, {split} seeds from {first}, "
    lines = [f"{head}scenario {entrants.scenario.name}", *entrants.notes()]
    print_comparison(results["records"], "\n".join(lines))
    return 0
