"""Figure of a design: commands, accuracy over time, attitude, and the results of rivals."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.manoeuvres.designer import Design
from satid_gym.manoeuvres.record import comparison, percent
from satid_gym.manoeuvres.trial import Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")  # Okabe and Ito's, for all eyes
_SMALL = 8
_RANGE = 5.0  # of bars, beyond which their axis is logarithmic


def png(design: Design) -> bytes:
    """The figure as a PNG; it needs matplotlib."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 11.5), layout="constrained")
    top, bottom = np.ravel(np.array(figure.subfigures(2, 1, height_ratios=[2.0, 1.0])))
    places = [*np.ravel(top.subplots(2, 2)), *np.ravel(bottom.subplots(1, 2))]
    for draw, axes in zip((_rates, _torques, _known, _turn, _rivals, _harder), places, strict=True):
        draw(axes, design)
        axes.tick_params(labelsize=_SMALL)
    for axes in places[:4]:
        axes.set_xlabel("time, s", fontsize=_SMALL)
    out = io.BytesIO()
    figure.savefig(out, dpi=110, format="png")
    return out.getvalue()


def _rates(axes: Axes, design: Design) -> None:
    plan, limit = design.manoeuvre, design.mission.satellite.rate_limit
    for i, name in enumerate("xyz"):
        axes.step(plan.time, plan.rate[:, i], where="post", color=_COLOURS[i], linewidth=1.2, label=name)
    for side in (-limit, limit):
        axes.axhline(side, color="0.6", linewidth=0.8, linestyle="--")
    axes.set_ylim(-1.3 * limit, 1.3 * limit)
    axes.set_title("commanded body rate, rad/s; dashed: limit", fontsize=10)
    axes.legend(loc="upper right", ncols=3, fontsize=_SMALL)


def _torques(axes: Axes, design: Design) -> None:
    plan, wheels = design.manoeuvre, design.mission.satellite.wheels
    for k in range(wheels.count):
        colour = _COLOURS[k % len(_COLOURS)]
        axes.step(plan.time, plan.torque[:, k], where="post", color=colour, linewidth=1.2, label=f"wheel {k + 1}")
    limit = float(wheels.max_torque.min())
    for side in (-limit, limit):
        axes.axhline(side, color="0.6", linewidth=0.8, linestyle="--")
    axes.set_ylim(-1.3 * limit, 1.3 * limit)
    axes.set_title("nominal motor torque, N m; dashed: limit", fontsize=10)
    axes.legend(loc="upper right", ncols=wheels.count, fontsize=_SMALL)


def _known(axes: Axes, design: Design) -> None:
    """Standard deviation of each parameter, actual errors, and the bound for any motion."""
    trial, world = design.trial, design.mission.scenario
    time = world.decision_period * np.arange(1, len(trial.error) + 1)
    for k in range(trial.std.shape[2]):
        axes.plot(time, trial.parameter_std[:, k], color=_COLOURS[k], linewidth=1.2, label=f"{NAMES[k]}, std")
    low, median, high = np.quantile(trial.error, [0.05, 0.5, 0.95], axis=1)
    axes.fill_between(time, low, high, color="0.5", alpha=0.2, linewidth=0.0)
    axes.plot(time, median, color="0.3", linewidth=1.0, label="error, median and 90 %")
    fine = world.sample_period * np.arange(len(design.least))
    axes.plot(fine, design.least, color="black", linewidth=0.9, linestyle=":", label="least std of any motion")
    if design.request.accuracy is not None:
        axes.axhline(design.request.accuracy, color="black", linewidth=0.8, linestyle="--", label="asked")
    axes.set_yscale("log")
    axes.set_title("relative accuracy of the inertia", fontsize=10)
    axes.legend(loc="upper right", fontsize=_SMALL)


def _turn(axes: Axes, design: Design) -> None:
    trial = design.trial
    time = design.mission.scenario.decision_period * np.arange(1, len(trial.turn) + 1)
    low, median, high = np.degrees(np.quantile(trial.turn, [0.0, 0.5, 1.0], axis=1))
    axes.fill_between(time, low, high, color=_COLOURS[0], alpha=0.2, linewidth=0.0, label="all flights")
    axes.plot(time, median, color=_COLOURS[0], linewidth=1.2, label="median")
    if design.request.turn_limit is not None:
        limit = np.degrees(design.request.turn_limit)
        axes.axhline(limit, color="0.6", linewidth=0.8, linestyle="--", label="limit")
    axes.set_ylim(bottom=0.0)
    axes.set_title("turn from the first attitude, deg", fontsize=10)
    axes.legend(loc="upper right", fontsize=_SMALL)


def _rivals(axes: Axes, design: Design) -> None:
    rows = comparison(design)
    _bars(axes, [name for name, _ in rows], [trial.accuracy for _, trial in rows], _shades(design, rows))
    axes.set_title("std of the worst moment; pale: beyond a limit", fontsize=10)


def _harder(axes: Axes, design: Design) -> None:
    rows = [("as the data sheet says", design.trial), *design.stressed.items()]
    errors = [float(np.quantile(trial.error[-1], 0.95, method="higher")) for _, trial in rows]
    _bars(axes, [name for name, _ in rows], errors, _shades(design, rows))
    axes.set_title("error that 95 % of the flights are below", fontsize=10)


def _shades(design: Design, rows: list[tuple[str, Trial]]) -> list[str]:
    """Colour of the manoeuvre, grey for others, pale for those that do not keep the limits."""
    kept = [trial.keeps(design.request.cost_limit) for _, trial in rows]
    return [_COLOURS[0] if k == 0 else "0.55" if good else "0.85" for k, good in enumerate(kept)]


def _bars(axes: Axes, names: list[str], values: list[float], colours: list[str]) -> None:
    """Bars, or dots on a logarithmic axis, where lengths mean nothing; none for flights that ended early."""
    shown = np.array([value if np.isfinite(value) else np.nan for value in values])
    from matplotlib.ticker import MaxNLocator

    labels = [f"{100.0 * v:.2g} %" if np.isfinite(v) else "" for v in shown]
    if np.nanmax(shown) > _RANGE * np.nanmin(shown):
        rows = np.arange(len(names))
        axes.scatter(shown, rows, color=colours, zorder=2)
        axes.set_yticks(rows, names)
        axes.grid(axis="y", color="0.9", linewidth=0.8, zorder=0)
        for value, row, label in zip(shown, rows, labels, strict=True):
            if label:
                axes.annotate(label, (value, row), (6, 0), textcoords="offset points", va="center", fontsize=_SMALL)
        axes.set_xscale("log")
        axes.set_xlim(0.5 * np.nanmin(shown), 4.0 * np.nanmax(shown))
    else:
        axes.bar_label(axes.barh(names, shown, color=colours), labels, padding=3, fontsize=_SMALL)
        axes.set_xlim(0.0, 1.3 * np.nanmax(shown))
        axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.invert_yaxis()
    axes.xaxis.set_major_formatter(lambda value, _: percent(value))
