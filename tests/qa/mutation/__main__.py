"""Mutation testing: `python -m tests.qa.mutation`, or `make mutation`.

Changes one thing at a time in the physics, the filters and the reward, and counts how often the tests notice. The
code runs as plain Python (NUMBA_DISABLE_JIT=1), so nothing is compiled again for a mutant. A run that was stopped
goes on where it was; mutants of a module whose source changed are tried again, survivors also when its tests changed.
"""

from __future__ import annotations

import hashlib
import json
import os
import queue
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import scipy.stats
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.config import check_integer, check_names
from satid_gym.files import check_writable, read_json, write_json
from tests.qa.mutation.equivalent import EQUIVALENT
from tests.qa.mutation.mutants import Mutant, find_mutants

ROOT = Path(__file__).parents[3]
TESTS: dict[str, tuple[str, ...]] = {
    "core/algebra": ("algebra",),
    "core/wheels": ("dynamics",),
    "core/truth/disturbance": ("dynamics",),
    "core/truth/draw": ("generator",),
    "core/truth/dynamics": ("dynamics",),
    "core/truth/faults": ("sensor_faults",),
    "core/truth/friction": ("friction",),
    "core/truth/increments": ("timing",),
    "core/truth/inertia_law": ("dynamics", "table_law", "mass_laws"),
    "core/truth/integrator": ("dynamics",),
    "core/truth/oscillator_draw": ("oscillators",),
    "core/truth/oscillator_geometry": ("oscillators",),
    "core/truth/oscillators": ("oscillators",),
    "core/truth/random_walk": ("sensors",),
    "core/truth/sampling": ("timing",),
    "core/truth/sensors": ("sensors", "sensor_faults"),
    "core/truth/speed_limit": ("dynamics",),
    "core/truth/state": ("dynamics", "oscillators"),
    "core/truth/step": ("mass_laws", "dynamics"),
    "core/belief/adaptation": ("walk",),
    "core/belief/alignment": ("timing",),
    "core/belief/announcement": ("mass_laws",),
    "core/belief/calibration": ("calibration",),
    "core/belief/coherence": ("coherence", "walk"),
    "core/belief/gating": ("vetting",),
    "core/belief/kalman": ("filters",),
    "core/belief/mode_prediction": ("modes",),
    "core/belief/modes": ("modes",),
    "core/belief/momentum_filter": ("filters",),
    "core/belief/momentum_model": ("filters",),
    "core/belief/momentum_start": ("filters",),
    "core/belief/retraction": ("calibration",),
    "core/belief/rate_filter": ("filters",),
    "core/observation": ("observation",),
    "core/reward": ("reward",),
    "core/sampling": ("timing",),
    "bounds/envelope": ("bounds",),
    "bounds/posterior": ("bounds",),
    "laws": ("laws", "config", "table_law"),
    "metrics": ("evaluation",),
}
GROUPS = {
    "physics": (
        *("core/algebra", "core/sampling", "core/wheels", "laws"),
        *(name for name in TESTS if name.startswith("core/truth/")),
    ),
    "filter": tuple(name for name in TESTS if name.startswith(("core/belief/", "bounds/"))),
    "reward": ("core/observation", "core/reward", "metrics"),
}


@dataclass(frozen=True, kw_only=True)
class MutationArguments:
    """Mutants to try."""

    modules: tuple[str, ...] = tuple(TESTS)
    """Modules of satid_gym, such as core/reward."""
    sample: int = 80
    """Mutants a module, drawn at random."""
    all: bool = False
    """Try every mutant instead of a sample."""
    seed: int = 0
    """Of the sample."""
    workers: int = 1
    """Processes that try mutants at the same time."""
    fresh: bool = False
    """Forget what earlier runs found."""
    output: Path = Path("results/mutation.json")
    """Where what is found goes, and is kept from run to run."""

    def check(self) -> None:
        """Refuse what cannot be tried.

        Raises:
            ValueError: a module is unknown or a number below 1.
        """
        check_names("module", self.modules, TESTS)
        check_integer("sample", self.sample)
        check_integer("workers", self.workers)


class Trials:
    """Processes of `tests.qa.mutation.trial`, any of which takes the next request."""

    def __init__(self, count: int) -> None:
        self._idle: queue.Queue[subprocess.Popen[str]] = queue.Queue()
        environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self._all = [
            subprocess.Popen(
                [sys.executable, "-m", "tests.qa.mutation.trial"],
                cwd=ROOT,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for _ in range(count)
        ]
        for process in self._all:
            self._idle.put(process)

    def run(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Outcome of one trial.

        Raises:
            RuntimeError: the trial itself failed, which says nothing about the mutant.
        """
        process = self._idle.get()
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(json.dumps(dict(request)) + "\n")
            process.stdin.flush()
            answer = process.stdout.readline()
        finally:
            self._idle.put(process)
        if not answer:
            raise RuntimeError(f"a trial process ended with status {process.wait()}; its message is above")
        result = json.loads(answer)
        if result["outcome"] in ("failed", "untested"):
            raise RuntimeError(f"no test ran on {request['path']}: {result.get('message', 'none was collected')}")
        return result

    def close(self) -> None:
        """End the processes."""
        for process in self._all:
            process.kill()


@dataclass(frozen=True)
class Target:
    """A module and the tests that are to notice its mutants."""

    name: str

    @property
    def path(self) -> str:
        """From the root of the checkout."""
        return f"satid_gym/{self.name}.py"

    @property
    def tests(self) -> list[str]:
        """From the root of the checkout."""
        return [f"tests/test_{name}.py" for name in TESTS[self.name]]

    @property
    def source(self) -> str:
        """The module's text."""
        return (ROOT / self.path).read_text(encoding="utf-8")

    def digests(self) -> dict[str, str]:
        """Of the module and of its tests: what an outcome holds for."""
        tests = "".join((ROOT / test).read_text(encoding="utf-8") for test in self.tests)
        return {name: hashlib.sha256(text.encode()).hexdigest()[:16] for name, text in
                (("source", self.source), ("tests", tests))}  # fmt: skip


def examine(target: Target, arguments: MutationArguments, trials: Trials, known: dict[str, Any], save: Any) -> None:
    """Try a module's mutants, those first-time whose outcome is not known; `known` is written to and saved."""
    mutants = find_mutants(target.source)
    chosen = list(range(len(mutants)))
    if not arguments.all and len(chosen) > arguments.sample:
        chosen = random.Random(f"{arguments.seed} {target.name}").sample(chosen, arguments.sample)
    digests = target.digests()
    outcomes: dict[str, Any] = known.get("outcomes", {}) if known.get("source") == digests["source"] else {}
    if known.get("tests") != digests["tests"]:
        outcomes = {key: value for key, value in outcomes.items() if value["outcome"] == "killed"}
    known.clear()
    known.update(digests, mutants=len(mutants), outcomes=outcomes)
    left = [i for i in chosen if mutants[i].key not in outcomes]
    if left:
        request = {"path": target.path, "tests": target.tests, "order": [], "index": None, "seconds": 600}
        clean = trials.run(request)
        if clean["outcome"] != "survived":
            raise RuntimeError(f"without a mutant {clean['killer']} fails: python -m pytest {' '.join(target.tests)}")
        kills: Counter[str] = Counter()

        def attempt(i: int) -> tuple[Mutant, dict[str, Any]]:
            # first those tests that kill most in their time
            rate = {test: (kills[test] + 0.2) / (0.01 + seconds) for test, seconds in clean["tests"].items()}
            order = sorted(rate, key=rate.__getitem__, reverse=True)
            seconds = int(10 + 4 * clean["seconds"])
            result = trials.run({**request, "order": order, "index": i, "seconds": seconds})
            kills[result["killer"]] += 1
            return mutants[i], result

        pool = ThreadPoolExecutor(arguments.workers)
        try:
            futures = [pool.submit(attempt, i) for i in left]
            for future in tqdm(futures, desc=target.name, unit="mutant"):
                mutant, result = future.result()
                outcomes[mutant.key] = {"outcome": result["outcome"], "killer": result["killer"]}
                save()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    known["sample"] = [mutants[i].key for i in sorted(chosen)]


def score(name: str, outcomes: Sequence[tuple[str, str, str]], total: int) -> dict[str, Any]:
    """Share of mutants killed with its 95 % interval (Wilson); outcomes are (module, mutant, outcome)."""
    killed = sum(outcome == "killed" for _, _, outcome in outcomes)
    equivalent = sum(
        outcome != "killed" and mutant in EQUIVALENT.get(module, {}) for module, mutant, outcome in outcomes
    )
    interval = scipy.stats.binomtest(killed, len(outcomes)).proportion_ci(method="wilson")
    return {
        "name": name,
        "mutants": total,
        "tried": len(outcomes),
        "killed": killed,
        "equivalent": equivalent,
        "rate": killed / len(outcomes),
        "rate_low": killed / total if len(outcomes) == total else float(interval.low),
        "rate_high": killed / total if len(outcomes) == total else float(interval.high),
    }


def scores(modules: Mapping[str, Any]) -> list[dict[str, Any]]:
    """By module, by group and of all."""
    tried = {
        name: [(name, key, module["outcomes"][key]["outcome"]) for key in module["sample"]]
        for name, module in modules.items()
    }
    rows = [score(name, outcomes, modules[name]["mutants"]) for name, outcomes in tried.items()]
    for group, members in (*GROUPS.items(), ("all", tuple(TESTS))):
        present = [name for name in members if name in tried]
        if present:
            total = sum(modules[name]["mutants"] for name in present)
            rows.append(score(group, [outcome for name in present for outcome in tried[name]], total))
    return rows


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """What is printed."""
    out = Table(
        "module", "mutants", "tried", "killed", "equivalent", "kill rate, 95 % interval", title="Mutants killed"
    )
    for row in rows:
        rate = f"{100 * row['rate']:.0f} % ({100 * row['rate_low']:.0f} to {100 * row['rate_high']:.0f})"
        out.add_row(row["name"], *(str(row[key]) for key in ("mutants", "tried", "killed", "equivalent")), rate)
    return out


@cli.on_interrupt("the same command goes on from where it was")
def main(arguments: MutationArguments) -> int:
    """Try, save, print; the exit code."""
    console = Console()
    state: dict[str, Any] = {}
    if arguments.output.exists() and not arguments.fresh:
        state = read_json(arguments.output, "remove it, or add --fresh", keys=["modules"])["modules"]
    check_writable(arguments.output.parent)
    head = result_head("tests.qa.mutation")

    def save(**more: Any) -> None:
        write_json(arguments.output, {**head, **more, "modules": state})

    trials = Trials(arguments.workers)
    try:
        for name in arguments.modules:
            examine(Target(name), arguments, trials, state.setdefault(name, {}), save)
    finally:
        trials.close()
    modules = {name: state[name] for name in arguments.modules}
    rows = scores(modules)
    save(scores=rows)
    for name, module in modules.items():
        for key in module["sample"]:
            if module["outcomes"][key]["outcome"] == "survived":
                reason = EQUIVALENT.get(name, {}).get(key)
                console.print(f"{name} {key}" + (f"  [equivalent: {reason}]" if reason else ""), markup=False)
    console.print(table(rows))
    return 0


if __name__ == "__main__":
    cli.run(main)
