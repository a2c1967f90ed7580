"""Write the README's figures from committed results: `python -m agents.readme`.

The results are docs/results/compare.json, timing.json and benchmark.json, as `python -m agents.compare --all --output
docs/results`, `python -m baselines.timing --output docs/results/timing.json` and `python -m satid_gym.benchmark
--output docs/results/benchmark.json` wrote them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.benchmark.results import read_results
from agents.docs.results_tables import claims, error_table
from baselines.command.markdown import table
from satid_gym.files import read_json, write_text

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
REMEDY = "restore it from the repository, or make it again with the command that this module's description names"


def benchmark_table(figures: Mapping[str, Any]) -> str:
    """Markdown table of the speed figures."""
    rows = [
        (
            "whole environment steps, 1024 environments",
            f"{figures['vector_1024_filter_steps_per_s'] / 1e6:.2f} million filter steps a second",
        ),
        ("the same with 64 environments", f"{figures['vector_64_filter_steps_per_s'] / 1e6:.2f} million"),
        (
            "the same with 1024, fixed process noise",
            f"{figures['vector_1024_one_walk_filter_steps_per_s'] / 1e6:.2f} million",
        ),
        (
            "256 environments of microsat in `default`; `flex`; `slosh`; `calibration`",
            "; ".join(
                f"{figures[f'vector_256_{name}_filter_steps_per_s'] / 1e6:.2f}"
                for name in ("default", "flex", "slosh", "calibration")
            )
            + " million",
        ),
        (
            "`gymnasium.make`",
            f"{figures['single_decisions_per_s'] / 1e3:.0f} thousand decisions a second, ten filter steps each",
        ),
        (
            "one filter step, compared with filterpy and the same model",
            f"{figures['filter_compiled_over_filterpy']:.0f} times faster",
        ),
        (
            "first step: to compile / with the compiled core cached",
            f"{figures['first_step_cold_s']:.0f} s / {figures['first_step_warm_s']:.1f} s, import included",
        ),
        ("memory", f"{figures['bytes_per_environment'] / 1e3:.1f} kB an environment"),
    ]
    return table(["what", "figure"], rows)


def written(text: str) -> str:
    """The README with its tables from the committed results."""
    results = read_results(RESULTS / "compare.json", REMEDY, keys=("records", "pairs", "revision", "command"))
    timing = read_json(RESULTS / "timing.json", REMEDY, keys=("decision_ms", "episodes"))
    text = between(text, "claims", claims(results, timing))
    text = between(text, "results", error_table(results))
    return between(text, "benchmark", benchmark_table(read_json(RESULTS / "benchmark.json", REMEDY)))


def between(text: str, name: str, content: str, source: str = "agents.readme") -> str:
    """The text with new content between the marks of `name`.

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
