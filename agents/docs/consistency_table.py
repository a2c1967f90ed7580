"""Table of the filter's consistency for the pages, from docs/results/consistency.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from baselines.command.markdown import table

_GROUPS = {  # policies by how much they excite the body
    "rate_square": ("rate_square",),
    "multi_step, sine": ("multi_step", "sine"),
    "one_step, zero": ("one_step", "zero"),
}

Cell = Mapping[str, Any]


def _shown(nees: float) -> str:
    return f"{nees:.2f}" if nees < 100.0 else f"{nees:.0e}".replace("e+0", "e")


def consistency_table(results: Mapping[str, Any]) -> str:
    """Final error of the first group and NEES of each, over satellites and inertia modes, world by world."""
    cells: Sequence[Cell] = results["cells"]
    rows = []
    for world in dict.fromkeys(cell["world"] for cell in cells):
        own = [cell for cell in cells if cell["world"] == world]
        groups = [[cell for cell in own if cell["policy"] in policies] for policies in _GROUPS.values()]
        errors = [100.0 * cell["final_error"] for cell in groups[0]]
        nees = [[cell["nees"] for cell in group] for group in groups]
        rows.append(
            [
                world,
                f"{min(errors):.2g} to {max(errors):.2g}",
                *(f"{_shown(min(values))} to {_shown(max(values))}" for values in nees),
            ]
        )
    head = ["world", "rate_square: error, %", *(f"{name}: NEES" for name in _GROUPS)]
    revision = f"{results['settings']['episodes']} validation episodes a cell; revision {results['revision'][:7]}."
    return table(head, rows, text_columns=1) + f"\n\n{revision}"
