"""Table of what looking ahead gains: `lookahead` over other policies, from the standing table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from agents.standing.summary import Row, mean_expected_error, rung
from baselines.command.markdown import table
from satid_gym.policies.lookahead import LookaheadPolicy

_ALL = "all"
HEAD = (
    *("scenario", "satellite", "expected error, %", "over its policy", "over `filter_mpc`", "over `mpc`"),
    *("over the best law", "NEES", "largest cost, %"),
)


def lookahead_table(results: Mapping[str, Any]) -> str:
    """Lines for each scenario that `lookahead` flies in: all satellites, and each; of the standing table."""
    own = [row for row in results["rows"] if row["policy"] == LookaheadPolicy.name]
    lines = []
    for scenario in dict.fromkeys(row["scenario"] for row in own):
        flown = [row for row in results["rows"] if row["scenario"] == scenario]
        for satellite in (_ALL, *dict.fromkeys(row["satellite"] for row in flown)):
            here = flown if satellite == _ALL else [row for row in flown if row["satellite"] == satellite]
            lines.append([f"`{scenario}`", satellite, *_line(here)])
    revisions = ", ".join(sorted({row["revision"][:7] for row in own}))
    return table(list(HEAD), lines, text_columns=2) + (
        f"\n\nExpected error: mean over {results['settings']['episodes']} test episodes a cell and over the flight, "
        "geometric mean over cells. NEES: least and largest of the cells. Cost: the largest of all limits and cells. "
        f"The best law is the closed loop with the least error there. Revision {revisions}; `{results['command']}`."
    )


def _line(rows: Sequence[Row]) -> list[str]:
    """Figures of the rows of a scenario, on one satellite or on all."""
    by_policy: dict[str, list[Row]] = {}
    for row in rows:
        by_policy.setdefault(row["policy"], []).append(row)
    own = by_policy[LookaheadPolicy.name]
    error = {name: mean_expected_error(flown) or math.inf for name, flown in by_policy.items()}
    ahead, base = error[LookaheadPolicy.name], own[0]["settings"]["policy"]
    law = min((name for name, flown in by_policy.items() if rung(flown[0]) == "law"), key=error.__getitem__)
    nees = [row["nees"] for row in own]

    def over(name: str) -> str:
        if name not in error:
            return "-"
        return "ended early" if math.inf in (ahead, error[name]) else f"{ahead / error[name]:.2f}"

    return [
        f"{100.0 * ahead:.3g}",
        f"`{base}` {over(base)}",
        over("filter_mpc"),
        over("mpc"),
        f"`{law}` {over(law)}",
        f"{min(nees):.2f} to {max(nees):.2f}",
        f"{100.0 * max(row['cost'] for row in own):.2f}",
    ]
