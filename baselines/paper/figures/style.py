"""Style of all figures: colours for colour-blind readers, titles, and the format of the files.

Palette: Okabe and Ito, Color Universal Design (2008).
"""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from satid_gym.files import write_bytes

AXES = ("x", "y", "z")
AXIS_COLOURS = ("#0072B2", "#D55E00", "#009E73")
AXIS_STYLES = ("-", "--", ":")
METHOD_COLOURS = {
    "ls": "#E69F00",
    "ekf": "#D55E00",
    "momentum_ls": "#009E73",
    "output_error": "#CC79A7",
    "momentum_ekf": "#0072B2",
    "momentum_rts": "#56B4E9",
}
TITLES = {
    "cubesat": "CubeSat",
    "microsat": "Microsat",
    "smallsat": "SmallSat",
    "static": "static",
    "step": "step",
    "drift": "drift",
    "periodic": "periodic",
    "one_step": "one step",
    "multi_step": "multi step",
    "sawtooth": "sawtooth",
    "sine": "sine",
    "multi_sine": "multi sine",
    "prbs": "PRBS",
    "chirp": "chirp",
    "sine_3axis": "sine 3-axis",
}

plt.rcParams.update(
    {
        "font.size": 9,
        "axes.titlesize": 10,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "legend.frameon": False,
        "figure.constrained_layout.use": True,
    }
)


def save(figure: Figure, folder: Path, name: str) -> None:
    """Write `name`.png and `name`.pdf, without a date so that equal runs give equal files, and close the figure."""
    for ending, undated in (("png", "Software"), ("pdf", "CreationDate")):
        drawn = io.BytesIO()
        figure.savefig(drawn, format=ending, dpi=150, metadata={undated: None})
        write_bytes(folder / f"{name}.{ending}", drawn.getvalue())
    plt.close(figure)
