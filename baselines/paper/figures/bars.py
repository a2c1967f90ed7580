"""Bar charts of the errors, by satellite and profile, and by inertia mode."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from baselines.paper.figures.style import METHOD_COLOURS, TITLES, save
from baselines.paper.methods import METHODS, PAPER_METHODS
from baselines.paper.summary import MODES, CellScore, CellTable
from satid_gym.profiles import PROFILES
from satid_gym.satellite import BENCHMARK_SATELLITES

ERROR_MIN = 1e-5  # %, lower end of the logarithmic axes
STATIC_METHODS = ("ls", "ekf", "momentum_ls", "momentum_ekf")
VARYING_METHODS = ("ls", "ekf", "momentum_ekf", "momentum_rts")


def draw(folder: Path, found: Sequence[CellScore]) -> None:
    """Write the figures of static errors, and of dynamic errors with the varying and the constant plant."""
    table = CellTable(found)
    figure, panels = plt.subplots(3, 1, figsize=(11, 9), sharex=True, sharey=True)
    for panel, satellite in zip(panels, BENCHMARK_SATELLITES, strict=True):
        _bars(panel, table, satellite, "static", STATIC_METHODS, "varying")
        panel.set_title(TITLES[satellite], loc="left")
        panel.set_ylabel("final error, %")
        _logarithmic(panel)
    _finish(figure, panels[-1:])
    save(figure, folder, "static")
    for plant, methods in (("varying", VARYING_METHODS), ("constant", PAPER_METHODS)):
        figure, grid = plt.subplots(3, 3, figsize=(14, 9.5), sharex=True, sharey="row" if plant == "constant" else True)
        for i, mode in enumerate(MODES):
            for j, satellite in enumerate(BENCHMARK_SATELLITES):
                _bars(grid[i, j], table, satellite, mode, methods, plant)
                grid[i, j].set_title(f"{TITLES[satellite]}, {TITLES[mode]}", loc="left")
                if plant == "varying":
                    _logarithmic(grid[i, j])
            grid[i, 0].set_ylabel("error over the last 20 %, %")
        _finish(figure, grid[-1])
        save(figure, folder, f"dynamic_{plant}")


def _bars(panel: Axes, table: CellTable, satellite: str, mode: str, methods: Sequence[str], plant: str) -> None:
    width = 0.8 / len(methods)
    for k, method in enumerate(methods):
        row = [table(profile, satellite, mode, method, plant) for profile in PROFILES]
        place = np.arange(len(row)) + (k - 0.5 * (len(methods) - 1)) * width
        mean, std = np.array([c.mean for c in row]), np.array([c.std for c in row])
        below = np.minimum(std, 0.95 * mean)  # an error bar down to zero would have no end on a logarithmic axis
        panel.bar(
            place,
            mean,
            width,
            yerr=(below, std),
            color=METHOD_COLOURS[method],
            ecolor="0.25",
            capsize=1.5,
            error_kw={"linewidth": 0.8},
            label=METHODS[method],
        )
        if method in PAPER_METHODS:
            panel.plot(
                place,
                [np.nan if c.paper is None else c.paper for c in row],
                linestyle="",
                marker="D",
                markersize=4.5,
                markerfacecolor="white",
                markeredgecolor="black",
                label="paper" if method == PAPER_METHODS[-1] else None,
            )


def _logarithmic(panel: Axes) -> None:
    panel.set_yscale("log")
    panel.set_ylim(ERROR_MIN, 50.0)
    panel.grid(visible=False, axis="x")


def _finish(figure: Figure, lowest: Sequence[Axes]) -> None:
    names = [TITLES[profile] for profile in PROFILES]
    tilt: dict[str, Any] = {"rotation": 40, "ha": "right"} if len(lowest) > 1 else {}
    for panel in lowest:
        panel.set_xticks(range(len(names)), names, **tilt)
    handles, labels = lowest[0].get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda k: labels[k] == "paper")
    figure.legend([handles[k] for k in order], [labels[k] for k in order], loc="outside upper center", ncols=6)
