"""Summary of the standing table: means of each policy in each cell, and the ladder of each scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.standing.tasks import BOUND, ORACLE, Task
from satid_gym.metrics import bootstrap
from satid_gym.policies.registry import PLANNERS, RATE_PLANNERS

RUNGS = {
    "reference": "nothing",
    "scripted": "waveform",
    "law": "closed loop",
    "planner": "planner",
    "learned": "learned",
    ORACLE: "oracle",
}
"""What flies, from nothing to an oracle, and what tables call it."""
NEES_RANGE = (0.3, 2.0)  # of the NEES in the mean
Row = dict[str, Any]


def row(task: Task, found: Mapping[str, Any], limit: float) -> Row:
    """Line of a policy in a cell; None stands for the expected error where an episode ended early."""
    result = found["result"]
    own = {
        "scenario": task.cell.scenario,
        "satellite": task.cell.satellite,
        "inertia": task.cell.inertia,
        "policy": task.name,
        "kind": task.kind,
        "settings": dict(task.settings),
        "revision": found["revision"],
        "episodes": len(result["error"]),
        "error": _mean(result["error"]),
    }
    if task.name == BOUND:
        return own
    expected = result["expected"]
    low, high = bootstrap(np.array(expected)) if None not in expected and len(expected) > 1 else (None, None)
    return {
        **own,
        "expected": _mean(expected),
        "expected_lo": low,
        "expected_hi": high,
        "expected_at_end": _mean(result["expected_at_end"]),
        "nees": _mean(result["nees"]),
        "nees_median": float(np.median(result["nees"])),
        "costs": result["costs"],
        "cost": max(result["costs"].values()),
        "terminated": result["terminated"] / len(result["error"]),
        "inside": not result["terminated"] and max(result["costs"].values()) <= limit,
        "decision_ms": result["decision_ms"],
    }


def _mean(values: Sequence[float | None]) -> float | None:
    return None if None in values else float(np.mean(np.array(values, float)))


def rung(row: Mapping[str, Any]) -> str:
    """Step of the ladder that a policy stands on."""
    if row["policy"] in (*PLANNERS, *RATE_PLANNERS):
        return "planner"
    return "law" if row["kind"] == "closed_loop" else str(row["kind"])


def is_consistent(row: Row) -> bool:
    """Whether the mean NEES is that of a consistent filter."""
    return bool(NEES_RANGE[0] <= row["nees"] <= NEES_RANGE[1])


def mean_expected_error(rows: Sequence[Row]) -> float | None:
    """Expected error, geometric mean over rows; None where an episode ended early."""
    errors = [row["expected"] for row in rows]
    return None if None in errors else float(np.exp(np.mean(np.log(np.array(errors, float)))))


def ladder(rows: Sequence[Row]) -> list[Row]:
    """Of one scenario the best policy of each rung, over all its cells.

    The best is that with the least expected error, geometric mean over cells, of those inside all limits in every cell;
    where none is, the one that is inside in most. A policy that does not fly all cells is left out. `over_best` is its
    error over that of the best rung below the oracle, of those inside in every cell if there are any; the oracle may
    fly fewer cells, and is compared with the best one in these.
    """
    flown = [r for r in rows if r["policy"] != BOUND]
    cells = set(map(_cell, flown))
    found = []
    for step in RUNGS:
        judged = []
        for policy in dict.fromkeys(r["policy"] for r in flown if rung(r) == step):
            mine = [r for r in flown if r["policy"] == policy]
            if len(mine) < len(cells) and step != ORACLE:
                continue
            judged.append(_over_cells(mine))
        if judged:
            found.append(min(judged, key=lambda j: (-j["inside"], j["expected"] is None, j["expected"] or 0.0)))
    contenders = [r for r in found if r["rung"] != ORACLE and r["expected"] is not None]
    kept = [r for r in contenders if r["inside"] == r["cells"]]
    best = min(kept or contenders, key=lambda r: r["expected"], default=None)
    return [{**step, "over_best": _over(step, best, flown)} for step in found]


def named(rows: Sequence[Row], policies: Sequence[str], steps: Sequence[Row]) -> list[Row]:
    """Steps as of `ladder`, of policies by name in the order given, in the cells that they fly."""
    best = next((step for step in steps if step["over_best"] == 1.0), None)
    found = [[r for r in rows if r["policy"] == policy] for policy in policies]
    return [{**step, "over_best": _over(step, best, rows)} for step in map(_over_cells, filter(None, found))]


def _over_cells(mine: Sequence[Row]) -> Row:
    """Step of a ladder: a policy over its cells."""
    return {
        "rung": rung(mine[0]),
        "policy": mine[0]["policy"],
        "cells": len(mine),
        "inside": sum(r["inside"] for r in mine),
        "consistent": sum(map(is_consistent, mine)),
        "expected": mean_expected_error(mine),
        "cost": max(r["cost"] for r in mine),
        "decision_ms": mine[0]["decision_ms"],
    }


def _over(step: Row, best: Row | None, rows: Sequence[Row]) -> float | None:
    """Expected error of a step over that of the best one in the same cells; None where either ended early."""
    if best is None or step["expected"] is None:
        return None
    there = {_cell(r) for r in rows if r["policy"] == step["policy"]}
    same = mean_expected_error([r for r in rows if r["policy"] == best["policy"] and _cell(r) in there])
    return None if same is None else float(step["expected"] / same)


def _cell(row: Row) -> tuple[str, str]:
    return row["satellite"], row["inertia"]


def show(scenario: str, steps: Sequence[Row]) -> None:
    """Print the ladder of a scenario."""
    print(f"\n{scenario}: expected error, mean over the flight and geometric over cells")
    _show(steps)


def show_named(steps: Sequence[Row]) -> None:
    """Print the policies that were asked for."""
    if steps:
        print("  asked for:")
        _show(steps)


def _show(steps: Sequence[Row]) -> None:
    for step in steps:
        error = "-" if step["expected"] is None else f"{100.0 * step['expected']:.4f}"
        over = "-" if step["over_best"] is None else f"{step['over_best']:.2f}"
        kept = f"inside in {step['inside']} of {step['cells']} cells, filter consistent in {step['consistent']}"
        print(f"  {RUNGS[step['rung']]:12s} {step['policy']:16s} {error:>8s} %  {over:>6s} of the best  {kept}")
