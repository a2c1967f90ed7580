"""Write the README's figures from committed results: `python -m agents.readme`.

The results are docs/results/compare.json and benchmark.json, as `python -m agents.compare --output docs/results`
and `python -m satid_gym.benchmark --output docs/results/benchmark.json` wrote them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.results import read_results
from baselines.ending import ended
from satid_gym.files import read_json, write_text

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "docs" / "results"
REMEDY = "restore it from the repository, or make it anew as this module's description says"
_ORDER = {"learned": 0, "closed_loop": 1, "scripted": 2, "reference": 3}


def results_table(results: Mapping[str, Any]) -> str:
    """Markdown table: final error by policy and inertia mode, mean over satellites, and share of time outside.

    Policies of a kind stand in the order of their geometric mean over the modes.
    """
    records: Sequence[Mapping[str, Any]] = results["records"]
    modes = list(dict.fromkeys(r["inertia_mode"] for r in records))
    policies = dict.fromkeys((r["policy"], r["kind"]) for r in records if r["kind"] in _ORDER)

    def mean(policy: str, name: str, mode: str | None = None) -> float:
        return float(np.mean([r[name] for r in records if r["policy"] == policy and mode in (None, r["inertia_mode"])]))

    def rank(item: tuple[str, str]) -> tuple[int, float]:
        return _ORDER[item[1]], float(np.mean([np.log(mean(item[0], "final_error_mean", mode)) for mode in modes]))

    lines = [f"| policy | kind | {' | '.join(modes)} | outside |", "|---|---|" + "---|" * (len(modes) + 1)]
    for policy, kind in sorted(policies, key=rank):
        errors = [f"{100 * mean(policy, 'final_error_mean', mode):#.3g}" for mode in modes]
        name = f"**{policy}**" if kind == "learned" else policy
        outside = f"{100 * mean(policy, 'outside_fraction'):.1f} %"
        lines.append(f"| {name} | {kind.replace('_', ' ')} | {' | '.join(errors)} | {outside} |")
    source = f"Revision {results['revision']}, {results['command'].split(' --output')[0]}."
    return "\n".join([*lines, "", source])


def benchmark_table(figures: Mapping[str, Any]) -> str:
    """Markdown table of the speed figures."""
    rows = [
        (
            "whole environment steps, 1024 environments",
            f"{figures['vector_1024_filter_steps_per_s'] / 1e6:.2f} million filter steps a second",
        ),
        ("the same with 64 environments", f"{figures['vector_64_filter_steps_per_s'] / 1e6:.2f} million"),
        (
            "the same with 1024, MomentumEKF",
            f"{figures['vector_1024_one_walk_filter_steps_per_s'] / 1e6:.2f} million",
        ),
        (
            "`gymnasium.make`",
            f"{figures['single_decisions_per_s'] / 1e3:.0f} thousand decisions a second (ten filter steps each)",
        ),
        (
            "filter step of the MomentumEKF, against filterpy with the same model",
            f"{figures['filter_compiled_over_filterpy']:.0f} times faster",
        ),
        (
            "first step, cold / with the cache warm",
            f"{figures['first_step_cold_s']:.0f} s / {figures['first_step_warm_s']:.1f} s, import included",
        ),
        ("memory", f"{figures['bytes_per_environment'] / 1e3:.1f} kB an environment"),
    ]
    return "\n".join(["| what | figure |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)])


def written(text: str) -> str:
    """The README with its tables made anew from the committed results."""
    results = read_results(RESULTS / "compare.json", REMEDY, keys=("records", "revision", "command"))
    text = between(text, "results", results_table(results))
    return between(text, "benchmark", benchmark_table(read_json(RESULTS / "benchmark.json", REMEDY)))


def between(text: str, name: str, content: str, source: str = "agents.readme") -> str:
    """The text with what stands between the marks of `name` made anew.

    Raises:
        ValueError: a mark is missing.
    """
    start, end = f"<!-- {name}: python -m {source} -->", f"<!-- end of {name} -->"
    if start not in text or end not in text:
        raise ValueError(f"the text must hold the lines {start!r} and {end!r}")
    head, _, rest = text.partition(start)
    return f"{head}{start}\n{content}\n{end}{rest.partition(end)[2]}"


def main() -> None:
    """Command line."""
    readme = ROOT / "README.md"
    write_text(readme, written(readme.read_text()))


if __name__ == "__main__":
    sys.exit(ended(main))
