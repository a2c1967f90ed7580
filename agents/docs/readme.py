"""Write the README's figures from committed results: `python -m agents.readme`.

The results are docs/results/compare.json, timing.json and benchmark.json, as `python -m agents.compare --all --output
docs/results`, `python -m baselines.timing --output docs/results/timing.json` and `python -m satid_gym.benchmark
--output docs/results/benchmark.json` wrote them.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.benchmark.results import read_results
from agents.benchmark.summary.ranking import Record, Standing, cells, standings
from agents.docs.results_tables import WAVE, error_table, ranked
from baselines.command.markdown import table
from satid_gym.files import read_json, write_text

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
_PLANNER = "mpc"  # whose time of a decision is what a network saves
REMEDY = "restore it from the repository, or make it again with the command next to its table in the docs"


def claims(results: Mapping[str, Any], timing: Mapping[str, Any]) -> str:
    """A paragraph on each learned policy: against the paper's eight, the best closed loop, the planner's time."""
    learned = [r["policy"] for r in ranked(results["records"]) if r["kind"] == "learned"]
    over_wave = {policy: over(results["records"], policy, WAVE) for policy in learned}
    return "\n".join(_claim(policy, standings(results, policy), timing, over_wave[policy]) for policy in learned)


def over(records: Sequence[Record], policy: str, other: str) -> list[float]:
    """Final error of a policy over that of another in each cell; empty where the other did not fly."""
    found = ({r["policy"]: r["final_error_mean"] for r in cell} for cell in cells(records))
    return [errors[policy] / errors[other] for errors in found if other in errors]


def _claim(policy: str, places: Sequence[Standing], timing: Mapping[str, Any], over_wave: Sequence[float]) -> str:
    ratios = [s.over_profile for s in places if s.over_profile is not None]
    against = [s.against_loop for s in places]
    sentences = [f"`{policy}` is inside the envelope in {sum(s.inside for s in places)} of {len(places)} cells."]
    if ratios:
        sentences.append(
            f"Its final error is {_range(ratios)} of that of the best of the paper's eight profiles inside the "
            f"envelope ({len(ratios)} of {len(places)} cells have one)."
        )
    else:
        any_profile = _range([s.over_any_profile for s in places])
        sentences.append(
            f"None of the paper's eight profiles is inside the envelope in any cell; its final error is {any_profile} "
            "of the lowest of the eight."
        )
    sentences.append(
        "Compared with the best closed loop inside the envelope, by paired 95 % intervals, it is "
        f"lower in {against.count('lower')} of the cells, level in {against.count('level')}, higher in "
        f"{against.count('higher')}" + (f"; {against.count(None)} have no such loop." if None in against else ".")
    )
    if over_wave:
        sentences.append(
            f"Its final error is {_range(over_wave)} of that of the tuned square wave of rate, `{WAVE}`, inside or "
            f"not (geometric mean {np.exp(np.mean(np.log(over_wave))):.2f})."
        )
    own, planner = timing["decision_ms"].get(policy), timing["decision_ms"].get(_PLANNER)
    if own and planner:
        sentences.append(
            f"A decision takes {own['alone']:.2g} ms when one episode flies alone ({_share(own, planner, 'alone')} of "
            f"`{_PLANNER}`'s time), {own['side_by_side']:.2g} ms an episode when {timing['episodes']} fly side by side "
            f"({_share(own, planner, 'side_by_side')})."
        )
    return textwrap.fill(" ".join(sentences), 118, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)


def _share(own: Mapping[str, float], other: Mapping[str, float], how: str) -> str:
    """A time over another one, as a fraction that reads well."""
    ratio = other[how] / own[how]
    return f"{1.0 / ratio:.2g} times" if ratio < 1.5 else f"1/{ratio:.0f}"


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f}"


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
