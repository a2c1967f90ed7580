"""Tables of a comparison for the terminal, of at most 100 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from agents.benchmark.summary.ranking import best
from agents.benchmark.summary.statistics import PAIRED_KINDS
from satid_gym.metrics import BEYOND_MAX

Record = Mapping[str, Any]

WIDTH = 100


def print_comparison(
    records: Sequence[Record], footer: str, bounds: Sequence[Record] = (), efficiencies: Sequence[Record] = ()
) -> None:
    """Two tables for each satellite: final error by inertia mode, and everything else averaged over modes."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=WIDTH)
    for satellite in dict.fromkeys(r["satellite"] for r in records):
        block = [r for r in records if r["satellite"] == satellite]
        policies = sorted(dict.fromkeys(r["policy"] for r in block), key=lambda p: _mean(block, p, "final_error_mean"))
        limits = [b for b in bounds if b["satellite"] == satellite]
        reached = [e for e in efficiencies if e["satellite"] == satellite]
        console.print(error_table(satellite, block, policies, limits))
        console.print(behaviour_table(satellite, block, policies))
        if reached:
            known = {e["policy"] for e in reached}  # not of stored figures
            paired = [p for p in policies if p in known and _kind(block, p) in PAIRED_KINDS]
            console.print(efficiency_line(reached, paired))
        if costly := cost_line(block, policies):
            console.print(costly)
    console.print(footer, style="dim")


def error_table(
    satellite: str, records: Sequence[Record], policies: Sequence[str], bounds: Sequence[Record] = ()
) -> Table:
    """Final error in %, with its 95 % interval, by policy and inertia mode; below it what the cell allows."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), title=f"{satellite}: final error, % [95 % interval]")
    table.add_column("policy", no_wrap=True)
    columns = []
    for mode in dict.fromkeys(r["inertia_mode"] for r in records):
        table.add_column(mode, justify="right", no_wrap=True)
        column = {r["policy"]: r for r in records if r["inertia_mode"] == mode}
        columns.append((column, best(column.values())))
    for policy in policies:
        cells = []
        for column, lowest in columns:
            r = column[policy]
            mean, low, high = (_percent(r[f"final_error_{end}"]) for end in ("mean", "lo", "hi"))
            text = Text(f"{mean} [{low} {high}]", style="bold" if r is lowest else "")
            cells.append(text)
        table.add_row(policy, *cells)
    for name in dict.fromkeys(b["policy"] for b in bounds):
        allowed = [f"{100.0 * b['final_error']:.4f}" for b in bounds if b["policy"] == name]
        table.add_row(name, *allowed, style="dim")
    return table


def behaviour_table(satellite: str, records: Sequence[Record], policies: Sequence[str]) -> Table:
    """Mean over the inertia modes of what else counts."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), title=f"{satellite}: mean over inertia modes")
    table.add_column("policy", no_wrap=True)
    table.add_column("kind", no_wrap=True)
    for name in _HEADINGS:
        table.add_column(name, justify="right", no_wrap=True)
    for policy in policies:
        mean = {name: _mean(records, policy, name) for name in _BEHAVIOUR}
        table.add_row(
            policy,
            _kind(records, policy).replace("_", " "),
            _percent(mean["mean_error_mean"]),
            "never" if mean["time_to_1pct_s"] is None else f"{mean['time_to_1pct_s']:.1f}",
            f"{100.0 * mean['outside_fraction']:.2f}",
            f"{mean['information_nats']:.0f}",
            "-" if mean["nees"] is None else f"{mean['nees']:.2f}",
            f"{mean['effort']:.3f}",
            f"{100.0 * mean['saturated_fraction']:.2f}",
            f"{100.0 * mean['terminated_fraction']:.1f}",
        )
    return table


_HEADINGS = (
    "mean\nerror %",
    "to 1 %\ns",
    "outside\n%",
    "gain\nnats",
    "\nNEES",
    "\neffort",
    "satur-\nated %",
    "ended\n%",
)
_BEHAVIOUR = (
    "mean_error_mean",
    "time_to_1pct_s",
    "outside_fraction",
    "information_nats",
    "nees",
    "effort",
    "saturated_fraction",
    "terminated_fraction",
)


def cost_line(records: Sequence[Record], policies: Sequence[str]) -> str:
    """Line of the policies whose mean cost is above 1 %; "" without any.

    The tables' columns have no room for the limits of panels, tanks and payload, which are in the cost.
    """
    costs = {policy: _mean(records, policy, "cost") for policy in policies}
    above = [f"{policy} {100.0 * cost:.2f}" for policy, cost in costs.items() if cost is not None and cost > BEYOND_MAX]
    limits = "largest of all limits, those of panels, tanks and payload too"
    return f"mean cost above {100.0 * BEYOND_MAX:g} % ({limits}): {', '.join(above)}" if above else ""


def efficiency_line(efficiencies: Sequence[Record], policies: Sequence[str]) -> Text:
    """Line of efficiencies: limit / achieved, bound / achieved, means over the modes, and median time of a decision."""
    parts = []
    for policy in policies:
        mine = [e for e in efficiencies if e["policy"] == policy]
        mean = {name: 100.0 * np.mean([e[name] for e in mine]) for name in ("efficiency", "excitation_efficiency")}
        milliseconds = np.median([e["decision_ms"] for e in mine])
        parts.append(
            f"{policy} {mean['excitation_efficiency']:.0f} % of the reference limit, "
            f"{mean['efficiency']:.1f} % of the bound, {milliseconds:.3f} ms a decision"
        )
    return Text("efficiency: " + "; ".join(parts))


def _kind(records: Sequence[Record], policy: str) -> str:
    return next(r["kind"] for r in records if r["policy"] == policy)


def _mean(records: Sequence[Record], policy: str, name: str) -> Any:
    """Mean over a policy's records; None where one of them has none, as stored ones of older revisions have no cost."""
    values = [r.get(name) for r in records if r["policy"] == policy]
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if len(known) == len(values) else None


def _percent(fraction: float) -> str:
    """Three digits, without the zero before the point: four intervals have to fit side by side."""
    percent = 100.0 * fraction
    decimals = 3 if percent < 1.0 else 2 if percent < 10.0 else 1
    return f"{percent:.{decimals}f}".removeprefix("0")
