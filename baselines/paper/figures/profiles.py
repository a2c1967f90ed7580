"""Figure of the eight torque profiles."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist

from baselines.paper.figures.style import AXES, AXIS_COLOURS, AXIS_STYLES, TITLES, save
from satid_gym.profiles import HORIZON, PROFILES, paper_torque
from satid_gym.satellite import SATELLITES


def draw(folder: Path, satellite: str = "microsat") -> None:
    """Write the figure: torque on the body over time, at the paper's amplitudes, clipped to the wheels' limits."""
    wheels = SATELLITES[satellite].wheels
    time = np.arange(0.0, HORIZON + 0.5)
    limit = 1e3 * wheels.max_torque.min()
    figure, panels = plt.subplots(4, 2, figsize=(10, 8), sharex=True, sharey=True)
    for panel, profile in zip(panels.flat, PROFILES, strict=True):
        torque = -1e3 * paper_torque(profile, SATELLITES[satellite], time) @ wheels.axes.T
        if np.ptp(torque, axis=1).max() < 1e-9:
            panel.step(time, torque[:, 0], where="post", color="black", linewidth=1.6, label="about every axis")
        else:
            for axis in range(3):
                panel.step(
                    time,
                    torque[:, axis],
                    where="post",
                    color=AXIS_COLOURS[axis],
                    linestyle=AXIS_STYLES[axis],
                    linewidth=1.8,
                    label=f"about {AXES[axis]}",
                )
        for side in (-limit, limit):
            panel.axhline(side, color="0.5", linewidth=0.8, linestyle="-.", label="wheel limit" if side > 0 else None)
        panel.set_title(TITLES[profile], loc="left")
    panels[0, 0].set_xlim(0.0, HORIZON)
    for panel in panels[-1]:
        panel.set_xlabel("time, s")
    figure.supylabel(f"torque on the body ({TITLES[satellite]}), mN m", fontsize=9)
    named: dict[str, Artist] = {}
    for panel in panels.flat:
        handles, labels = panel.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    named["wheel limit"] = named.pop("wheel limit")  # to the end
    figure.legend(list(named.values()), list(named), loc="outside upper center", ncols=5)
    save(figure, folder, "profiles")
