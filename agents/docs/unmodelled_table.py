"""Table of what becomes of a filter that is told too little, from docs/results/unmodelled.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from baselines.command.markdown import table

Cell = Mapping[str, Any]


def _pair(cells: Sequence[Cell], name: str, pattern: str, factor: float = 1.0) -> str:
    """Means over cells, without and with `inflate`."""
    plain, inflated = factor * np.mean([cell[name] for cell in cells], axis=0)
    return f"{plain:{pattern}} / {inflated:{pattern}}"


def unmodelled_table(results: Mapping[str, Any]) -> str:
    """NEES, final error and alarms, means over satellites and inertia modes, by world and policy."""
    cells: Sequence[Cell] = results["cells"]
    rows = []
    for world, policy in dict.fromkeys((cell["world"], cell["policy"]) for cell in cells):
        own = [cell for cell in cells if (cell["world"], cell["policy"]) == (world, policy)]
        figures = _pair(own, "nees", ".2g"), _pair(own, "nees_settled", ".2g"), _pair(own, "final_error", ".2g", 100.0)
        rows.append([world, policy, *figures, f"{100.0 * np.mean([cell['alarmed'][0] for cell in own]):.0f}"])
    head = ["world", "policy", "NEES", "NEES from 60 s on", "final error, %", "flights with an alarm, %"]
    flown = "{episodes} {split} episodes a cell; revision ".format(**results["settings"])
    ended = sum(sum(cell["ended"]) for cell in cells)
    flown += f"{results['revision'][:7]}; {ended or 'none'} of {2 * results['settings']['episodes'] * len(cells)} "
    flown += "flights ended early."
    return table(head, rows, text_columns=2) + "\n\n" + flown
