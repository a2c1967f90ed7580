"""Grids: the settings that `baselines.tune` tries for each kind of baseline.

A grid is a list of rows of settings; along a row the settings lead further and further out of the envelope. Each
baseline names its own grid in its entry of `satid_gym.policies.registry.BASELINES`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from satid_gym.control.planning.planner import PLANNING_MARGIN
from satid_gym.profiles import PAPER_AMPLITUDES, PAPER_SCALES
from satid_gym.satellite import Satellite

Settings = dict[str, float]
Grid = Callable[[Satellite, str], list[list[Settings]]]  # of a satellite and a scenario's name

AMPLITUDES = np.geomspace(0.0005, 1.0, 34).round(5).tolist()  # of the torque limit; a quarter apart
STAGGERED_PERIODS = [6.0, 12.0, 24.0, 36.0, 60.0, 120.0]  # s
RATE_PERIODS = [4.0, 6.0, 9.0, 12.0, 18.0, 24.0, 36.0, 48.0, 60.0, 84.0]  # s
MARGINS = [3.0, 2.75, 2.6, 2.5, 2.4, 2.25, 2.0]  # standard deviations


def amplitudes(satellite: Satellite, scenario: str) -> list[list[Settings]]:
    """Amplitudes of a scripted signal."""
    return [[{"amplitude": a} for a in AMPLITUDES]]


def paper_profile(name: str) -> Grid:
    """Amplitudes of one of the paper's eight profiles; in scenario "paper" the paper's own alone."""

    def grid(satellite: Satellite, scenario: str) -> list[list[Settings]]:
        if scenario != "paper" or satellite.name not in PAPER_SCALES:
            return amplitudes(satellite, scenario)
        torque = PAPER_AMPLITUDES[name] * PAPER_SCALES[satellite.name]
        return [[{"amplitude": float(torque / satellite.wheels.max_torque.min())}]]

    return grid


def staggered_square(satellite: Satellite, scenario: str) -> list[list[Settings]]:
    """Amplitudes of each period."""
    return [[{"amplitude": a, "period": period} for a in AMPLITUDES] for period in STAGGERED_PERIODS]


def rate_square(satellite: Satellite, scenario: str) -> list[list[Settings]]:
    """Margins of the rate loop for each period."""
    return [[{"period": period, "margin": k} for k in MARGINS] for period in RATE_PERIODS]


def planner(satellite: Satellite, scenario: str) -> list[list[Settings]]:
    """Margins of the rate loop; in scenario "paper" the default one alone, because a flight takes long."""
    return [[{"margin": k} for k in ([PLANNING_MARGIN] if scenario == "paper" else MARGINS)]]
