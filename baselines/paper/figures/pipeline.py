"""Figure of one flight, from command to estimate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from baselines.paper.figures.style import AXES, AXIS_COLOURS, AXIS_STYLES, METHOD_COLOURS, TITLES, save
from baselines.paper.flight import ProfileFlight, fly_profile
from baselines.paper.methods import METHODS, OUR_METHODS, PAPER_METHODS, Estimate, estimate
from satid_gym import metrics
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.satellite import SATELLITES

TRACKED = ("ekf", "momentum_ekf")


def draw(folder: Path, seeds: Sequence[int], satellite: str = "microsat", profile: str = "sine") -> None:
    """Write the figure, by default of the paper's example; its time series are those of the first seed."""
    flight = fly_profile(satellite, "periodic", profile, seeds)
    found = [estimate(flight, row) for row in range(len(seeds))]
    figure = plt.figure(figsize=(11, 10.5))
    figure.suptitle(f"{TITLES[satellite]}, {TITLES[profile]}, periodic inertia", fontsize=11)
    halves: Any = figure.subfigures(1, 2)
    left, right = halves
    _motion(left.subplots(4, 1, sharex=True), flight)
    upper, lower = right.subfigures(2, 1, height_ratios=(3.0, 1.1))
    panels = upper.subplots(3, 1, sharex=True)
    for axis, panel in enumerate(panels):
        _tracking(panel, flight, found[0], axis)
    _legend(panels[0])
    panels[-1].set_xlabel("time, s")
    _errors(lower.subplots(), flight, found)
    save(figure, folder, "pipeline")


def _motion(panels: Sequence[Axes], flight: ProfileFlight) -> None:
    """Draw rates, wheel speeds, torque and energies."""
    rates, speeds, torques, energies = panels
    for axis in range(3):
        style: dict[str, Any] = {"color": AXIS_COLOURS[axis], "linestyle": AXIS_STYLES[axis], "linewidth": 1.6}
        rates.plot(flight.time, 1e3 * flight.gyro[:, 0, axis], label=f"about {AXES[axis]}", **style)
        speeds.plot(flight.time, flight.wheel_speed[:, 0, axis], label=f"wheel {axis + 1}", **style)
    rates.set_ylabel("body rate, mrad/s")
    speeds.set_ylabel("wheel speed, rad/s")
    start = flight.time[:-1]
    torques.step(
        start, 1e3 * flight.applied[:, 0, 0], where="post", color=AXIS_COLOURS[1], linewidth=0.9, label="applied"
    )
    torques.step(start, 1e3 * flight.commanded[:, 0], where="post", color="black", linewidth=1.4, label="commanded")
    torques.set_ylabel("motor torque of wheel 1, mN m")
    body, wheels = energy(flight, 0)
    energies.plot(flight.time, body + wheels, color="black", linewidth=1.4, label="total")
    energies.plot(flight.time, wheels, color=AXIS_COLOURS[0], linestyle="--", linewidth=1.6, label="wheels")
    energies.plot(flight.time, body, color=AXIS_COLOURS[1], linestyle=":", linewidth=1.8, label="body")
    energies.set_yscale("log")
    energies.set_ylim(1e-5, None)
    energies.set_ylabel("kinetic energy, J")
    energies.set_xlabel("time, s")
    for panel in panels:
        _legend(panel)


def _legend(panel: Axes) -> None:
    """Place the legend above the panel."""
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=3, fontsize=8, borderpad=0.1)


def energy(flight: ProfileFlight, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic energies (N + 1,), J: of the body without the wheels' spin, and of that spin.

    Source: Hughes, Spacecraft Attitude Dynamics (1986), ch. 3.
    """
    wheels = SATELLITES[flight.satellite].wheels
    rate = flight.rate[:, row]
    rest = flight.inertia[:, row] - wheels.rotor_inertia
    spin = flight.wheel_speed[:, row] + rate @ wheels.axes
    return 0.5 * np.einsum("ni,nij,nj->n", rate, rest, rate), 0.5 * (spin**2) @ wheels.inertia


def _tracking(panel: Axes, flight: ProfileFlight, found: dict[str, Estimate], axis: int) -> None:
    """Draw a true and an estimated moment with bands of three standard deviations."""
    truth = flight.inertia[:, 0, axis, axis]
    panel.plot(flight.time, truth, color="0.7", linewidth=4.5, label="truth")
    for method in TRACKED:
        course = found[method]
        mean, band = course.inertia[:, axis], 3.0 * course.std[:, axis]
        colour = METHOD_COLOURS[method]
        panel.fill_between(flight.time, mean - band, mean + band, color=colour, alpha=0.2, linewidth=0)
        panel.plot(flight.time, mean, color=colour, linewidth=1.4, label=f"{METHODS[method]} ± 3σ")
    middle, reach = truth.mean(), np.ptp(truth)
    panel.set_ylim(middle - 1.1 * reach, middle + 1.3 * reach)
    panel.set_ylabel(f"$J_{{{AXES[axis]}{AXES[axis]}}}$, kg m²")


def _errors(panel: Axes, flight: ProfileFlight, found: Sequence[dict[str, Estimate]]) -> None:
    """Draw the error over the last 20 %: mean and standard deviation over the seeds."""
    shown = (*PAPER_METHODS, *OUR_METHODS)
    for place, method in enumerate(shown):
        errors = [
            100.0 * metrics.final_error(metrics.relative_error(inertia_tensors(estimated[method].inertia), truth)[1:])
            for estimated, truth in zip(found, flight.inertia.swapaxes(0, 1), strict=True)
        ]
        mean, std = float(np.mean(errors)), float(np.std(errors, ddof=min(1, len(errors) - 1)))
        panel.barh(place, mean, xerr=std, color=METHOD_COLOURS[method], ecolor="0.3", capsize=2)
        panel.text(1.15 * (mean + std), place, f"{mean:.2g} %", va="center", fontsize=8)
    panel.set_yticks(range(len(shown)), [METHODS[method] for method in shown])
    panel.invert_yaxis()
    panel.set_xscale("log")
    panel.set_xlim(1e-3, 20.0)
    panel.set_xlabel("error over the last 20 % of the flight, %")
