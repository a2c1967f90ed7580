"""Rows of the leaderboard: every policy of a cell, or of all inertia modes of a satellite, and their bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.benchmark.summary.ranking import best, keeps_envelope

Record = Mapping[str, Any]

ALL_MODES = "all"
_SCORES = (
    "final_error_mean",
    "mean_error_mean",
    "time_to_1pct_s",
    "outside_fraction",
    "nees",
    "information_nats",
    "effort",
    "saturated_fraction",
    "terminated_fraction",
    "reward",
)
_REACHED = ("excitation_efficiency", "efficiency", "decision_ms")
_INTERVALS = ("final_error_lo", "final_error_hi", "mean_error_lo", "mean_error_hi")


def leaderboard(results: Mapping[str, Any], satellite: str, mode: str) -> list[dict[str, Any]]:
    """Rows of one cell, best first, its bounds last.

    Args:
        results: as compare.json has them.
        satellite: which.
        mode: inertia mode, or `ALL_MODES` for means over all that were flown; those have no intervals, for the
            modes share their seeds.

    Returns:
        One mapping for each policy with its scores, `inside` where it keeps to the envelope, and `best` where no
        other that does has a lower final error. Times that one of the modes never reaches, and NEES that it does not
        have, are None.
    """

    def chosen(name: str) -> list[Record]:
        block = [r for r in results[name] if r["satellite"] == satellite]
        return block if mode == ALL_MODES else [r for r in block if r["inertia_mode"] == mode]

    records, reached = chosen("records"), chosen("efficiencies")
    rows = []
    for policy in dict.fromkeys(r["policy"] for r in records):
        mine = [r for r in records if r["policy"] == policy]
        row: dict[str, Any] = {"policy": policy, "kind": mine[0]["kind"]}
        row |= {name: _mean(mine, name) for name in _SCORES}
        row |= {name: mine[0][name] if mode != ALL_MODES else None for name in _INTERVALS}
        row |= {name: _mean([e for e in reached if e["policy"] == policy], name) for name in _REACHED}
        rows.append(row)
    lowest = best(rows)
    for row in rows:
        row["inside"] = keeps_envelope(row)
        row["best"] = row is lowest
    limits = [
        {"policy": name, "kind": "bound", "final_error_mean": _mean(mine, "final_error"), "best": False}
        for name in dict.fromkeys(b["policy"] for b in chosen("bounds"))
        for mine in [[b for b in chosen("bounds") if b["policy"] == name]]
    ]
    return [*sorted(rows, key=lambda row: row["final_error_mean"]), *limits]


def _mean(records: Sequence[Record], name: str) -> float | None:
    values = [r[name] for r in records]
    return None if not values or None in values else float(np.mean(values))
