"""Table of what looking ahead gains: `lookahead_tour` over its tour and over `filter_mpc`, from the standing table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from baselines.command.markdown import table
from satid_gym.policies.filter_mpc import FilterMPCPolicy
from satid_gym.policies.lookahead_tour import LookaheadTourPolicy

HEAD = ("scenario", "satellite", "expected error, %", "over its tour", "over `filter_mpc`", "NEES", "largest cost, %")
Row = Mapping[str, Any]


def lookahead_table(results: Mapping[str, Any]) -> str:
    """A line for each scenario and satellite that `lookahead_tour` flies in; `results` are those of the table."""
    rows, lines = results["rows"], []
    own = [row for row in rows if row["policy"] == LookaheadTourPolicy.name]
    for place in dict.fromkeys((row["scenario"], row["satellite"]) for row in own):
        here = [row for row in rows if (row["scenario"], row["satellite"]) == place]
        flown = [row for row in here if row["policy"] == LookaheadTourPolicy.name]
        tour = flown[0]["settings"]["tour"]
        ahead, alone, planner = (expected(here, name) for name in (flown[0]["policy"], tour, FilterMPCPolicy.name))
        nees, cost = [row["nees"] for row in flown], max(row["cost"] for row in flown)
        lines.append(
            [
                f"`{place[0]}`",
                place[1],
                f"{100.0 * ahead:.3g}",
                f"`{tour}` {ahead / alone:.2f}" if np.isfinite(alone) else f"`{tour}` ended early",
                f"{ahead / planner:.2f}",
                f"{min(nees):.2f} to {max(nees):.2f}",
                f"{100.0 * cost:.2f}",
            ]
        )
    revisions = ", ".join(sorted({row["revision"][:7] for row in own}))
    return table(list(HEAD), lines, text_columns=2) + (
        f"\n\nExpected error: mean over {results['settings']['episodes']} test episodes a cell and over the flight, "
        "geometric mean over the inertia modes. NEES: least and largest of these. Cost: the largest of all limits. "
        f"Revision {revisions}; `{results['command']}`."
    )


def expected(rows: Sequence[Row], policy: str) -> float:
    """Expected error of a policy, geometric mean over its rows; infinite where a flight ended early."""
    own = [row["expected"] for row in rows if row["policy"] == policy]
    return float(np.exp(np.mean([np.inf if value is None else np.log(value) for value in own])))
