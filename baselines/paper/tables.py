"""Cells as Markdown tables, ours beside the paper's."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import fmean

from baselines.paper.figure_style import TITLES
from baselines.paper.methods import METHODS, OUR_METHODS, PAPER_METHODS
from baselines.paper.published import published
from baselines.paper.summary import MODES, Cell, Table
from satid_gym.laws import INERTIA_MODES
from satid_gym.profiles import PROFILES
from satid_gym.satellite import SATELLITES

Row = Sequence[str]


def markdown(header: Row, rows: Sequence[Row], left: int) -> str:
    """A table whose first `left` columns are text and whose others are numbers."""
    rule = ["---" if i < left else "---:" for i in range(len(header))]
    return "\n".join("| " + " | ".join(row) + " |" for row in [header, rule, *rows])


def number(percent: float) -> str:
    """Three digits, and no more than four decimals."""
    return "not identified" if math.isnan(percent) else f"{percent:.{_decimals(percent)}f}"


def _decimals(percent: float) -> int:
    return 2 if percent >= 0.995 else 3 if percent >= 0.0995 else 4


def _spread(cell: Cell) -> str:
    """Mean and standard deviation to the same decimals."""
    if math.isnan(cell.mean):
        return number(cell.mean)
    return f"{number(cell.mean)} ± {cell.std:.{_decimals(cell.mean)}f}"


def static_table(found: Sequence[Cell]) -> str:
    """24 rows: the paper's two estimators as published and as here, and ours."""
    table = Table(found)
    rows = [
        [TITLES[satellite], TITLES[profile], *_row(table, profile, satellite, "static", "varying", OUR_METHODS)]
        for satellite in SATELLITES
        for profile in PROFILES
    ]
    return markdown(["satellite", "profile", *_header(OUR_METHODS)], rows, 2)


def dynamic_table(found: Sequence[Cell], satellite: str, plant: str) -> str:
    """24 rows of one satellite; our estimators where the plant varies."""
    table = Table(found)
    ours = OUR_METHODS if plant == "varying" else ()
    rows = [
        [TITLES[mode], TITLES[profile], *_row(table, profile, satellite, mode, plant, ours)]
        for mode in MODES
        for profile in PROFILES
    ]
    return markdown(["inertia", "profile", *_header(ours)], rows, 2)


def record_table(found: Sequence[Cell]) -> str:
    """Mean error over the whole flight, averaged over profiles: filter against smoother."""
    table = Table(found)
    methods = ("ekf", "momentum_ekf", "momentum_rts")
    rows = []
    for mode in INERTIA_MODES:
        for satellite in SATELLITES:
            mean = {m: fmean(table(p, satellite, mode, m).record_mean for p in PROFILES) for m in methods}
            rows.append([TITLES[mode], TITLES[satellite], *_bold(mean, {m: number(x) for m, x in mean.items()})])
    return markdown(["inertia", "satellite", *(METHODS[method] for method in methods)], rows, 2)


def condition_table(found: Sequence[Cell]) -> str:
    """Condition numbers of the regressions, static."""
    table = Table(found)
    batch = ("ls", "momentum_ls")
    rows = []
    for profile in PROFILES:
        row = [TITLES[profile]]
        for satellite in SATELLITES:
            for method in batch:
                condition = table(profile, satellite, "static", method).condition
                row.append("-" if condition is None else f"{condition:.1f}")
            row.append(f"{100.0 * table(profile, satellite, 'static', 'ls').wheel_saturated:.0f}")
        rows.append(row)
    columns = [*(METHODS[method] for method in batch), "saturated %"]
    return markdown(["profile", *(f"{TITLES[s]} {c}" for s in SATELLITES for c in columns)], rows, 1)


def _header(ours: Sequence[str]) -> Row:
    return [
        *(f"paper {METHODS[method]}" for method in PAPER_METHODS),
        *(f"here {METHODS[method]}" for method in PAPER_METHODS),
        *(METHODS[method] for method in ours),
    ]


def _row(table: Table, profile: str, satellite: str, mode: str, plant: str, ours: Sequence[str]) -> Row:
    theirs = published()[profile, satellite, mode]
    blocks = [_bold(theirs, {method: f"{theirs[method]:.2f}" for method in PAPER_METHODS})]
    for methods in (PAPER_METHODS, ours):
        cells = {method: table(profile, satellite, mode, method, plant) for method in methods}
        means = {method: cell.mean for method, cell in cells.items()}
        blocks.append(_bold(means, {method: _spread(cell) for method, cell in cells.items()}))
    return [text for block in blocks for text in block]


def _bold(values: Mapping[str, float], texts: Mapping[str, str]) -> Row:
    """Texts in order, the best in bold, and with it those that print the same number."""
    known = [value for value in values.values() if not math.isnan(value)]
    best = number(min(known)) if known else ""
    return [f"**{text}**" if number(values[name]) == best else text for name, text in texts.items()]
