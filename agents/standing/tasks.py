"""Tasks of the standing table: one policy, the oracle or the bound in one cell, each with a file of its own."""

from __future__ import annotations

import copy
import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from baselines.command.provenance import revision
from baselines.scenarios.flights import Cell, Flown, flown
from baselines.scenarios.oracle import PLANS, effort, search
from baselines.scenarios.rivals import rivals
from baselines.scenarios.tune import tuned
from baselines.studies.performance_bound import lacks_bound, performance_bound
from baselines.studies.timing import TimedPolicy
from satid_gym.evaluation import Split, seeds
from satid_gym.files import DamagedFileError, read_json, write_json
from satid_gym.gym_api import COSTS
from satid_gym.policies.custom import digest
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.lookahead import LookaheadPolicy
from satid_gym.policy import Policy, observation_settings, only_mission
from satid_gym.problem import problem
from satid_gym.satellite import SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS

ORACLE, BOUND = "oracle", "bound"
SCORES = ("expected", "expected_at_end", "error", "nees")
_DIGITS = 5  # of a score
Values = Mapping[str, Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Task:
    """What flies in a cell.

    Attributes:
        cell: where.
        name, kind: of the policy, or of what stands for it.
        settings: of a baseline.
        policy: itself; None of oracle and bound.
        fly: makes the result; plain values.
        identity: all that the result depends on but the code.
    """

    cell: Cell
    name: str
    kind: str
    settings: Values = field(default_factory=dict)
    policy: Policy | None = None
    fly: Callable[[], dict[str, Any]]
    identity: Values

    @property
    def digest(self) -> str:
        """SHA-256 of `identity`."""
        return hashlib.sha256(json.dumps(self.identity, sort_keys=True).encode()).hexdigest()

    def file(self, folder: Path) -> Path:
        """Where its result is kept."""
        return folder / self.cell.scenario / f"{self.cell.satellite}-{self.cell.inertia}-{self.name}.json"

    def kept(self, folder: Path) -> dict[str, Any] | None:
        """Its result, if the folder has that of the same episodes and settings; a damaged file is as good as none."""
        try:
            found = read_json(self.file(folder), "it is flown again", keys=("digest", "revision", "seconds", "result"))
        except (FileNotFoundError, DamagedFileError):
            return None
        return found if found["digest"] == self.digest else None

    def run(self, folder: Path) -> dict[str, Any]:
        """Fly, and keep the result."""
        start = time.perf_counter()
        result = self.fly()
        found = {
            "digest": self.digest,
            "revision": revision(),
            "seconds": round(time.perf_counter() - start, 2),
            "result": result,
        }
        write_json(self.file(folder), found)
        return found


@dataclass(frozen=True, kw_only=True)
class Episodes:
    """Seeds of a table: split, number, and of these the number that the oracle flies; and the limit of each cost."""

    split: Split
    count: int
    oracle: int
    cost: float

    @property
    def seeds(self) -> list[int]:
        """All of them."""
        return seeds(self.split, self.count)


def tasks_of(cell: Cell, episodes: Episodes, others: Sequence[Policy]) -> list[Task]:
    """All that flies in a cell: the scenario's rivals, the other policies that fit it, oracle and bound.

    Raises:
        ValueError: a rival has no tuned settings; the message says how to find them.
    """
    rows = [policy_task(cell, episodes, *trial) for trial in tuned(cell.scenario, cell.satellite).values()]
    rows += [policy_task(cell, episodes, {}, p) for p in others if not misfit(p, cell)]
    if episodes.oracle and cell.scenario in PLANS:
        chosen = seeds(episodes.split, episodes.oracle)
        searched = {"plan": PLANS[cell.scenario].__name__, "effort": effort(cell.scenario)}
        identity = {**_where(cell), "policy": ORACLE, "seeds": chosen, "cost": episodes.cost, **searched}
        rows.append(
            Task(
                cell=cell,
                name=ORACLE,
                kind=ORACLE,
                identity=identity,
                fly=lambda: _scores(search(cell, chosen, episodes.cost), None),
            )
        )
    if not lacks_bound(problem(cell.satellite, cell.inertia, cell.scenario)):
        identity = {**_where(cell), "policy": BOUND, "seeds": episodes.seeds}
        rows.append(Task(cell=cell, name=BOUND, kind=BOUND, identity=identity, fly=lambda: _bound(cell, episodes)))
    return rows


def misfit(policy: Policy, cell: Cell) -> str:
    """Why a policy cannot fly there, such as another observation than it was trained for; "" where it can."""
    asked = {"control": "rate", **observation_settings(policy)}
    try:
        copy.copy(policy).reset(only_mission(problem(cell.satellite, cell.inertia, cell.scenario, **asked)), [0])
    except ValueError as error:
        return str(error)
    return ""


def _where(cell: Cell) -> dict[str, Any]:
    world, satellite = SCENARIOS[cell.scenario], SATELLITES[cell.satellite]
    return {"scenario": world.to_dict(), "satellite": satellite.to_dict(), "inertia": cell.inertia}


def policy_task(cell: Cell, episodes: Episodes, settings: Values, policy: Policy) -> Task:
    """Task of a policy, with the settings of a baseline, in a cell."""
    about = {**_where(cell), "policy": policy.name, "settings": dict(settings), "seeds": episodes.seeds}
    decides = policy.policy if isinstance(policy, LookaheadPolicy) else policy
    if isinstance(decides, LearnedPolicy) or policy.name not in rivals(cell.scenario):
        about["sha256"] = digest(decides)

    def fly() -> dict[str, Any]:
        timed = TimedPolicy(copy.copy(policy))  # cells fly side by side
        return _scores(flown(cell, timed, episodes.seeds, num_threads=1), timed.decision_ms)

    return Task(
        cell=cell, name=policy.name, kind=policy.kind, settings=settings, policy=policy, fly=fly, identity=about
    )


def _scores(flight: Flown, decision_ms: float | None) -> dict[str, Any]:
    """What is kept of flights: scores by episode, None where one ended early, and costs in the mean."""
    return {
        **{name: [_short(value) for value in getattr(flight, name).tolist()] for name in SCORES},
        "costs": dict(zip(COSTS, map(_short, flight.costs.mean(axis=0).tolist()), strict=True)),
        "terminated": int(flight.terminated.sum()),
        "decision_ms": None if decision_ms is None else _short(decision_ms),
    }


def _short(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None


def _bound(cell: Cell, episodes: Episodes) -> dict[str, Any]:
    """Error at the end that no estimator beats under any excitation inside the envelope, root mean square."""
    found = performance_bound(SATELLITES[cell.satellite], cell.inertia, episodes.seeds, SCENARIOS[cell.scenario])
    return {"error": [_short(found.final_errors()[BOUND])]}
