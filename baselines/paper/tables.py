"""Markdown tables of the cells: the paper's results and ours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import fmean

from baselines.command.markdown import Row, table
from baselines.paper.figures.style import TITLES
from baselines.paper.methods import METHODS, OUR_METHODS, PAPER_METHODS
from baselines.paper.published import published
from baselines.paper.summary import MODES, CellScore, CellTable
from satid_gym.laws import INERTIA_MODES
from satid_gym.profiles import PROFILES
from satid_gym.satellite import BENCHMARK_SATELLITES


def number(percent: float) -> str:
    """Percentage with three digits, and at most four decimals."""
    return "not identified" if math.isnan(percent) else f"{percent:.{_decimals(percent)}f}"


def _decimals(percent: float) -> int:
    return 2 if percent >= 0.995 else 3 if percent >= 0.0995 else 4


def _spread(cell: CellScore) -> str:
    """Mean and standard deviation with the same number of decimals."""
    if math.isnan(cell.mean):
        return number(cell.mean)
    return f"{number(cell.mean)} ± {cell.std:.{_decimals(cell.mean)}f}"


def static_table(found: Sequence[CellScore]) -> str:
    """Table of 24 rows: the paper's two estimators as published and as rerun, and ours."""
    cell_of = CellTable(found)
    rows = [
        [TITLES[satellite], TITLES[profile], *_row(cell_of, profile, satellite, "static", "varying", OUR_METHODS)]
        for satellite in BENCHMARK_SATELLITES
        for profile in PROFILES
    ]
    return table(["satellite", "profile", *_header(OUR_METHODS)], rows, 2)


def dynamic_table(found: Sequence[CellScore], satellite: str, plant: str) -> str:
    """Table of 24 rows for one satellite; with our estimators if the plant varies."""
    cell_of = CellTable(found)
    ours = OUR_METHODS if plant == "varying" else ()
    rows = [
        [TITLES[mode], TITLES[profile], *_row(cell_of, profile, satellite, mode, plant, ours)]
        for mode in MODES
        for profile in PROFILES
    ]
    return table(["inertia", "profile", *_header(ours)], rows, 2)


def record_table(found: Sequence[CellScore]) -> str:
    """Table of the mean error over the whole flight, averaged over profiles: filters and smoother."""
    cell_of = CellTable(found)
    methods = ("ekf", "momentum_ekf", "momentum_rts")
    rows = []
    for mode in INERTIA_MODES:
        for satellite in BENCHMARK_SATELLITES:
            mean = {m: fmean(cell_of(p, satellite, mode, m).record_mean for p in PROFILES) for m in methods}
            rows.append([TITLES[mode], TITLES[satellite], *_bold(mean, {m: number(x) for m, x in mean.items()})])
    return table(["inertia", "satellite", *(METHODS[method] for method in methods)], rows, 2)


def condition_table(found: Sequence[CellScore]) -> str:
    """Table of the regressions' condition numbers with static inertia."""
    cell_of = CellTable(found)
    batch = ("ls", "momentum_ls")
    rows = []
    for profile in PROFILES:
        row = [TITLES[profile]]
        for satellite in BENCHMARK_SATELLITES:
            for method in batch:
                condition = cell_of(profile, satellite, "static", method).condition
                row.append("-" if condition is None else f"{condition:.1f}")
            row.append(f"{100.0 * cell_of(profile, satellite, 'static', 'ls').wheel_saturated:.0f}")
        rows.append(row)
    columns = [*(METHODS[method] for method in batch), "saturated %"]
    return table(["profile", *(f"{TITLES[s]} {c}" for s in BENCHMARK_SATELLITES for c in columns)], rows, 1)


def _header(ours: Sequence[str]) -> Row:
    return [
        *(f"paper {METHODS[method]}" for method in PAPER_METHODS),
        *(f"here {METHODS[method]}" for method in PAPER_METHODS),
        *(METHODS[method] for method in ours),
    ]


def _row(cell_of: CellTable, profile: str, satellite: str, mode: str, plant: str, ours: Sequence[str]) -> Row:
    theirs = published()[profile, satellite, mode]
    blocks = [_bold(theirs, {method: f"{theirs[method]:.2f}" for method in PAPER_METHODS})]
    for methods in (PAPER_METHODS, ours):
        cells = {method: cell_of(profile, satellite, mode, method, plant) for method in methods}
        means = {method: cell.mean for method, cell in cells.items()}
        blocks.append(_bold(means, {method: _spread(cell) for method, cell in cells.items()}))
    return [text for block in blocks for text in block]


def _bold(values: Mapping[str, float], texts: Mapping[str, str]) -> Row:
    """Texts in order; the best and those that print the same number are bold."""
    known = [value for value in values.values() if not math.isnan(value)]
    best = number(min(known)) if known else ""
    return [f"**{text}**" if number(values[name]) == best else text for name, text in texts.items()]
