"""Table of a comparison in pairs: one policy next to others, cell by cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from baselines.command.markdown import table
from baselines.scenarios.compare import MEASURES, against, by_cell


def paired_table(results: Mapping[str, Any], policy: str, others: Sequence[str]) -> str:
    """One line for each cell: scores of a policy, and its expected error and error at the end over those of others."""
    lines: list[list[str]] = []
    ratios: dict[str, list[dict[str, Any]]] = {name: [] for name in others}
    for cell in by_cell(results["rows"]):
        own = cell[policy]
        for name in others:
            ratios[name].append(against(own, cell[name]))
        lines.append(
            [
                f"{own['satellite']} {own['inertia']}",
                *(f"{100.0 * np.mean(own[measure]):.3f}" for measure in MEASURES),
                *(", ".join(_marked(ratios[name][-1][measure]) for measure in MEASURES) for name in others),
                f"{np.mean(own['nees']):.2f}",
                f"{100.0 * max(own['costs'].values()):.2f}",
            ]
        )
    head = ["cell", "expected error, %", "at the end, %", *(f"over `{name}`" for name in others)]
    said = []
    for name in others:
        means = {m: np.exp(np.mean([np.log(found[m]["ratio"]) for found in ratios[name]])) for m in MEASURES}
        clear = [found["expected"]["clear"] for found in ratios[name]]
        said.append(
            f"{means['expected']:.2f} and {means['error']:.2f} times those of `{name}`, the first clearly lower in "
            f"{clear.count(-1)} of {len(clear)} cells, clearly higher in {clear.count(1)}"
        )
    settings, split = results["settings"], results["seeds"]["split"]
    source = (
        f"{settings['episodes']} {split} episodes a cell. Over others: ratios of the means, expected error and error "
        "at the end; + and - mark a paired 95 % interval that is above or below zero. Geometric means over the cells: "
        f"{'; '.join(said)}. Cost: the largest, in % of the time. Revision {results['revision'][:7]}."
    )
    return table([*head, "NEES", "cost"], lines, text_columns=1) + "\n\n" + source


def _marked(over: Mapping[str, Any]) -> str:
    return f"{over['ratio']:.2f}{('', ' +', ' -')[over['clear']]}"
