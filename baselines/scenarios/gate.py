"""Gate of a scenario: `python -m baselines.scenarios.gate --scenario flex`. Does the choice of excitation matter there?

Flies, by body rates, from nothing to an oracle:

- zero and random;
- the paper's eight profiles, and square waves of rate, each with its best settings inside all limits;
- the closed loop made for the scenario, `shaped_square`, `swing_and_stop`, `swing_between` or `clear_square`, with its
  best settings inside all limits;
- planners: `filter_mpc` and `lookahead` with the whole model, where there is a star tracker `greedy` and `mpc`, which
  know none, and where wheels avoid a band of speed `mpc`, which knows it;
- learned policies that are named, as they are;
- an oracle that is told the true modes, or the sky, and searches the plan of each episode by the cross-entropy method.

Where there are imaging windows an operator flies too, who turns to the targets and does no more, and all others but
zero and random excite in the gaps between windows alone.

The oracle searches settings of that closed loop alone, in `slosh` corners of `corner_tour`: what it finds bounds that
family of excitations, not all. In `wheels4` it searches the rates of every decision, from flights of `clear_square` and
`mpc` on.

Settings are chosen on tuning seeds and flown on validation seeds. What is compared is the error that the filter
expects, its mean over the flight, and not the one that is found at its end: of many plans an oracle would else choose a
lucky one. It is compared over the same episodes, those that the oracle flies too.

A policy is inside where no episode ends early and each cost is at most a limit, in the mean over episodes. The oracle's
search holds the limit in every episode, which is stricter: a rival may pay for one episode with another.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from baselines.command import cli
from baselines.command.cluster import RayAddress, each
from baselines.command.provenance import result_head
from baselines.scenarios.flights import Cell, Flown, flown
from baselines.scenarios.oracle import PLANS, search
from baselines.scenarios.rivals import choose, rivals
from baselines.studies.timing import TimedPolicy
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, write_json
from satid_gym.gym_api import COSTS
from satid_gym.laws import INERTIA_MODES, MASS_MODES
from satid_gym.policies.custom import find_any
from satid_gym.policy import Policy, observation_settings, only_mission
from satid_gym.problem import problem
from satid_gym.profiles import PROFILES
from satid_gym.satellite import SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS

Entry = tuple[str, dict[str, float], Flown, float | None]  # name, settings and flight of a policy; ms a decision


@dataclass(frozen=True, kw_only=True)
class Gate:
    """Settings of the study."""

    scenario: str = "flex"
    """Scenario to judge."""
    satellite: str = "microsat"
    """Satellite that flies in it."""
    inertia: str = "static"
    """Inertia mode."""
    cost: float = 0.01
    """Largest cost of each kind, as a share of the time."""
    tuned: int = 32
    """Episodes that judge a setting, tuning seeds."""
    episodes: int = 64
    """Episodes that are flown, validation seeds."""
    oracle: int = 32
    """Episodes of these that the oracle flies too; 0: no oracle."""
    rivals: tuple[str, ...] = ()
    """Rivals that fly; all where none is named."""
    policies: tuple[str, ...] = ()
    """More policies to fly: names of shipped ones, paths of a policy's files or of a run, module:name (runs the
    module's code), or NAME= before either of the two."""
    output: Path | None = None
    """File to write, by default results/gate_SCENARIO.json."""
    ray: RayAddress = None
    """Choose and search on a Ray cluster: auto, HOST:PORT, ray://HOST:PORT, or local for one of this machine."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or taken, a number is out of range, a policy cannot fly here, or there is no
            plan for an oracle to search.
        """
        check_names("scenario", [self.scenario], SCENARIOS)
        check_names("satellite", [self.satellite], SATELLITES)
        check_names("inertia mode", [self.inertia], (*INERTIA_MODES, *MASS_MODES))
        check_number("cost", self.cost, high=1.0)
        check_integer("tuned", self.tuned)
        check_integer("episodes", self.episodes)
        check_integer("oracle", self.oracle, low=0, high=self.episodes)
        if self.oracle > 0 and self.scenario not in PLANS:
            raise ValueError(
                f"scenario {self.scenario!r} has no plan for the oracle to search: give one that has, such as flex, or "
                "--oracle 0"
            )

        if self.rivals:
            check_names("rival", self.rivals, rivals(self.scenario))
        taken = [*rivals(self.scenario), "oracle"]
        for policy in self.others():
            if policy.name in taken:
                raise ValueError(f"the name {policy.name!r} is taken: give the policy another, NAME=PATH")
            taken.append(policy.name)
            asked = {"control": "rate", **observation_settings(policy)}
            policy.reset(only_mission(problem(self.satellite, self.inertia, self.scenario, **asked)), [])

    def others(self) -> list[Policy]:
        """The policies that are named."""
        return [find_any(policy) for policy in self.policies]

    @property
    def file(self) -> Path:
        """File to write."""
        return self.output or Path(f"results/gate_{self.scenario}.json")

    @property
    def cell(self) -> Cell:
        """What is flown."""
        return Cell(scenario=self.scenario, satellite=self.satellite, inertia=self.inertia)


def row(gate: Gate, entry: Entry, oracle: Flown | None) -> dict[str, Any]:
    """Line of the table."""
    name, settings, flight, decision_ms = entry
    return {
        "policy": name,
        "settings": settings,
        "episodes": len(flight.error),
        "expected": _mean(flight.expected),
        "over_oracle": None if oracle is None else over(flight, oracle),
        "expected_at_end": _mean(flight.expected_at_end),
        "final_error": float(flight.error.mean()),
        "nees": float(flight.nees.mean()),
        "nees_median": float(np.median(flight.nees)),
        "costs": dict(zip(COSTS, flight.costs.mean(axis=0).tolist(), strict=True)),
        "terminated": float(flight.terminated.mean()),
        "inside": flight.inside(gate.cost),
        "decision_ms": decision_ms,
    }


def over(flight: Flown, oracle: Flown) -> float | None:
    """Expected error over the oracle's in the episodes that both have flown; None where one of them ended early."""
    own, best = _mean(flight.first(len(oracle.expected)).expected), _mean(oracle.expected)
    return None if own is None or best is None else own / best


def _mean(expected: np.ndarray) -> float | None:
    return float(expected.mean()) if np.isfinite(expected).all() else None


def show(rows: list[dict[str, Any]]) -> None:
    """Print a line for each policy, and how the rungs of the ladder compare."""
    heads = {
        "expected, %": 12,
        "over oracle": 12,
        "at the end, %": 14,
        "final error, %": 15,
        "NEES (median)": 14,
        "largest cost, %": 22,
    }
    print(f"{'policy':16s} " + " ".join(f"{head:>{width}s}" for head, width in heads.items()) + " ended")
    for own in rows:
        worst = max(own["costs"], key=own["costs"].get)
        expected, at_end = (
            "-" if own[name] is None else f"{100 * own[name]:.4f}" for name in ("expected", "expected_at_end")
        )
        nees, cost = f"{own['nees']:.2f} ({own['nees_median']:.2f})", f"{worst} {100 * own['costs'][worst]:.2f}"
        print(
            f"{own['policy']:16s} {expected:>12s} {_ratio(own):>12s} {at_end:>14s} {100 * own['final_error']:15.4f} "
            f"{nees:>14s} {cost:>22s} {100 * own['terminated']:4.0f} %"
        )
    inside = {own["policy"]: own for own in rows if own["inside"]}
    print("inside all limits: " + ", ".join(inside))
    if "oracle" in inside:
        profiles = [inside[name] for name in PROFILES if name in inside]
        eight = min(profiles, key=lambda own: own["expected"], default=None)
        others = [own["policy"] for own in rows if own["policy"] not in (*PROFILES, "zero", "random", "oracle")]
        rungs = {"best of the eight": eight} | {name: inside.get(name) for name in others}
        found = [f"{name} {_ratio(own) if own else 'not inside'}" for name, own in rungs.items()]
        print("over the oracle, same episodes: " + ", ".join(found))


def _ratio(own: dict[str, Any]) -> str:
    return "-" if own["over_oracle"] is None else f"{own['over_oracle']:.3f}"


def entry_of(cell: Cell, name: str, cost: float, tuned: int, episodes: int) -> Entry:
    """A rival with its best settings, and how it flies; the last two are numbers of episodes."""
    settings, policy = choose(cell, rivals(cell.scenario)[name], cost, tuned)
    timed = TimedPolicy(policy)
    flight = flown(cell, timed, seeds("validation", episodes))
    return name, settings, flight, timed.decision_ms


def main_rows(gate: Gate) -> list[dict[str, Any]]:
    """All lines of the table."""
    calls = [(gate.cell, name, gate.cost, gate.tuned, gate.episodes) for name in gate.rivals or rivals(gate.scenario)]
    entries: list[Entry] = list(each(entry_of, calls, gate.ray, desc=gate.scenario, unit="policy"))
    oracle = None
    for policy in gate.others():
        timed = TimedPolicy(policy)
        flight = flown(gate.cell, timed, seeds("validation", gate.episodes))
        entries.append((policy.name, {}, flight, timed.decision_ms))
    if gate.oracle:
        oracle = search(gate.cell, seeds("validation", gate.oracle), gate.cost, ray=gate.ray)
        entries.append(("oracle", {}, oracle, None))
    return [row(gate, entry, oracle) for entry in entries]


@cli.on_interrupt("no file is written")
def main(gate: Gate) -> int:
    """Judge the scenario of the command line; returns the exit code."""
    check_writable(gate.file.parent)
    rows = main_rows(gate)
    settings = {name: value for name, value in dataclasses.asdict(gate).items() if name != "ray"}
    flown_seeds = seeds("validation", gate.episodes)
    head = result_head("baselines.scenarios.gate", settings, split="validation", seeds=flown_seeds)
    write_json(gate.file, {**head, "rows": rows})
    show(rows)
    return 0


if __name__ == "__main__":
    cli.run(main)
