"""Figure of the error over the length of the record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from baselines.paper.figures.style import METHOD_COLOURS, TITLES, save
from baselines.paper.methods import METHODS
from baselines.paper.study import HORIZON, HORIZON_METHODS, HORIZONS, EpisodeScore
from satid_gym.satellite import BENCHMARK_SATELLITES

MARKERS = {"ls": "o", "ekf": "s", "momentum_ls": "^", "momentum_ekf": "D"}


def draw(folder: Path, runs: Sequence[EpisodeScore]) -> None:
    """Write the figure: static error over profiles and seeds, mean and band from the 10th to the 90th percentile."""
    figure, panels = plt.subplots(1, 3, figsize=(12, 4.4), sharey=True)
    for panel, satellite in zip(panels, BENCHMARK_SATELLITES, strict=True):
        for method in HORIZON_METHODS:
            errors = [_errors(runs, satellite, method, horizon) for horizon in HORIZONS]
            low, high = (np.array([np.percentile(e, q) for e in errors]) for q in (10.0, 90.0))
            panel.fill_between(HORIZONS, low, high, color=METHOD_COLOURS[method], alpha=0.2, linewidth=0)
            panel.plot(
                HORIZONS,
                [e.mean() for e in errors],
                color=METHOD_COLOURS[method],
                marker=MARKERS[method],
                markersize=4,
                label=METHODS[method],
            )
        panel.axvline(HORIZON, color="0.4", linewidth=0.9, linestyle=":", label="horizon of the tables")
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xticks([10, 30, 100, 300, 600], ["10", "30", "100", "300", "600"])
        panel.minorticks_off()
        panel.set_title(TITLES[satellite], loc="left")
        panel.set_xlabel("length of the record, s")
    panels[0].set_ylabel("final error, %")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5)
    save(figure, folder, "horizon")


def _errors(runs: Sequence[EpisodeScore], satellite: str, method: str, horizon: float) -> np.ndarray:
    """Errors of the runs that identified the inertia, in %."""
    errors = np.array(
        [
            100.0 * run.error
            for run in runs
            if (run.satellite, run.method, run.horizon, run.inertia_mode) == (satellite, method, horizon, "static")
        ]
    )
    return errors[np.isfinite(errors)]
