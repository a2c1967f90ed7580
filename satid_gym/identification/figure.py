"""Figure of an identification: estimates with their bands, residuals, and the contribution of each flight."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.identification.estimate import theta_sizes
from satid_gym.identification.flights import OUTLIER
from satid_gym.identification.identify import Identification
from satid_gym.identification.variation.steps_and_drift import Variation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")  # Okabe and Ito's, for all eyes
_STRIPS = 240  # of time, over all flights
_FLIGHTS_MAX = 12  # that have a place of their own in the bars


def png(found: Identification) -> bytes:
    """The figure as a PNG.

    Raises:
        ValueError: matplotlib is not there.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ValueError('for the figure and the page, pip install ".[telemetry]" in the checkout') from error
    alone = len(found.flights) == 1
    brief = alone and found.variation is None
    heights = [0.8 if brief else 1.5, 1.0, 0.7, *([] if alone else [0.8])]
    figure = Figure(figsize=(11.0, 3.375 * sum(heights)), layout="constrained")
    top, middle, lower, *bottom = np.ravel(np.array(figure.subfigures(len(heights), 1, height_ratios=heights)))
    if brief:
        _compare_to_nominal(top.subplots(), found)
    else:
        for k, axes in enumerate(np.ravel(top.subplots(2, 3))):
            if found.variation is None:
                _estimate(axes, found, k)
            else:
                _over_time(axes, found, found.variation, k)
        top.supxlabel("flight" if found.variation is None else _time_of(found), fontsize=9)
        _legend(top)
    _residuals(middle.subplots(), found)
    _legend(middle, markerscale=3)
    _told(lower.subplots(), found)
    for part in bottom:
        _shares(part.subplots(), found)
    out = io.BytesIO()
    figure.savefig(out, dpi=110, format="png")
    return out.getvalue()


def _legend(part: SubFigure, **style: Any) -> None:
    """One legend for all axes of a part, next to them."""
    named: dict[str, Any] = {}
    for axes in part.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        part.legend(list(named.values()), list(named), loc="outside upper right", ncols=6, fontsize=8, **style)


def _time_of(found: Identification) -> str:
    """Label of a time axis."""
    return "time, s" if len(found.flights) == 1 else "time in flights 1, 2, ... one after the other, s"


def _compare_to_nominal(axes: Axes, found: Identification) -> None:
    """Parameters of a single flight less nominal, with their intervals in words."""
    sizes = theta_sizes(found.satellite)
    nominal = inertia_parameters(found.satellite.inertia, "full")
    for k, parameter in enumerate(found.parameters[:6]):
        said = "not identified"
        if parameter.determined:
            off, reach = (100.0 * part / sizes[k] for part in (parameter.value - nominal[k], 2.0 * parameter.std))
            axes.errorbar(off, k, xerr=reach, fmt="o", color=_COLOURS[0], markersize=5, capsize=3)
            places = max(0, 1 - int(np.floor(np.log10(parameter.std))))  # two digits of the standard deviation
            said = f"{parameter.value:.{places}f} \u00b1 {parameter.std:.{places}f} kg m\u00b2"
        axes.text(1.01, k, said, transform=axes.get_yaxis_transform(), va="center", fontsize=9)
    axes.axvline(0.0, color="0.6", linewidth=1.0)
    axes.set_yticks(np.arange(6), NAMES)
    axes.set_ylim(5.6, -0.6)
    axes.grid(axis="y", color="0.9", linewidth=0.8)
    axes.set_title(
        "estimate less nominal, % of the moment (products: of the geometric mean of two); bars: 2 std", fontsize=10
    )
    axes.tick_params(labelsize=8)


def _estimate(axes: Axes, found: Identification, k: int) -> None:
    """A parameter over the rotor: band of two standard deviations, and each flight's own estimate."""
    rotor = found.satellite.wheels.inertia[0]
    value, std = found.parameters[k].value / rotor, np.sqrt(found.over_rotor_covariance[k, k])
    axes.set_title(f"{NAMES[k]} / rotor inertia", fontsize=10)
    if np.isfinite(value):
        axes.axhspan(value - 2.0 * std, value + 2.0 * std, color=_COLOURS[0], alpha=0.18, label="all, 2 std")
        axes.axhline(value, color=_COLOURS[0], linewidth=1.4)
    else:
        axes.text(0.5, 0.5, "not identified", ha="center", transform=axes.transAxes)
    numbers = np.arange(1, len(found.flights) + 1)
    alone = np.array([flight.theta[k] for flight in found.flights]) / rotor
    spread = 2.0 * np.array([flight.std[k] for flight in found.flights]) / rotor
    style: dict[str, Any] = {"fmt": "o", "color": "0.25", "markersize": 4, "linewidth": 1.0}
    axes.errorbar(numbers, alone, spread, label="alone, formal 2 std", **style)
    good = np.isfinite(alone)
    if good.any() and np.isfinite(value):
        reach = 1.2 * max(4.0 * std, float(np.quantile(np.abs(alone[good] - value) + spread[good], 0.75)))
        axes.set_ylim(value - reach, value + reach)
    axes.set_xticks(numbers if len(numbers) <= _FLIGHTS_MAX else numbers[:: len(numbers) // _FLIGHTS_MAX + 1])
    axes.set_xlim(0.5, len(numbers) + 0.5)
    axes.tick_params(labelsize=8)


def _over_time(axes: Axes, found: Identification, varied: Variation, k: int) -> None:
    """A parameter over the rotor and over time: band of two standard deviations, and where it steps."""
    rotor, start = found.satellite.wheels.inertia[0], 0.0
    axes.set_title(f"{NAMES[k]} / rotor inertia", fontsize=10)
    if not np.isfinite(varied.theta[:, k]).any():
        axes.text(0.5, 0.5, "not identified", ha="center", transform=axes.transAxes)
    for flight in np.unique(varied.flight):
        mine = varied.flight == flight
        time = start + varied.time[mine] - varied.time[mine][0]
        value, std = varied.theta[mine, k] / rotor, varied.std[mine, k] / rotor
        label = "over time, 2 std" if start == 0.0 else None
        axes.fill_between(time, value - 2.0 * std, value + 2.0 * std, color=_COLOURS[0], alpha=0.18, label=label)
        axes.plot(time, value, color=_COLOURS[0], linewidth=1.4)
        for step in varied.steps:
            if step.flight == flight:
                at = start + np.nan_to_num(step.time - varied.time[mine][0])
                axes.axvline(at, color=_COLOURS[1], linewidth=0.8, linestyle=":")
        start = float(time[-1]) * 1.02
        axes.axvline(start, color="0.8", linewidth=0.8)
    axes.tick_params(labelsize=8)


def _residuals(axes: Axes, found: Identification) -> None:
    """Wheel speeds as measured less as balanced, flight after flight."""
    start, edges, sizes = 0.0, [], []
    for number, flight in enumerate(found.flights, start=1):
        if len(flight.time) == 0:
            continue
        since = flight.time - flight.time[0]
        out = np.isin(flight.time, flight.outliers)
        for k in range(flight.residual.shape[1]):
            label = f"wheel {k + 1}" if number == 1 else None
            colour = _COLOURS[k % len(_COLOURS)]
            axes.plot(start + since[~out], flight.residual[~out, k], ".", markersize=2.5, color=colour, label=label)
            axes.plot(start + since[out], flight.residual[out, k], "x", markersize=3.5, color="0.65")
        name = "" if len(found.flights) == 1 else f" {number}"
        axes.text(start, 0.97, name, transform=axes.get_xaxis_transform(), va="top", fontsize=8)
        start += float(since[-1]) * 1.02
        edges.append(start)
        sizes.append(np.abs(flight.residual[~out]).ravel())
    for edge in edges[:-1]:
        axes.axvline(edge, color="0.8", linewidth=0.8)
    axes.margins(x=0.0)
    if sizes and (size := np.concatenate(sizes)).size:
        reach = 1.8 * float(np.quantile(size, 0.99))
        axes.set_ylim(-reach, reach)
    axes.set_title(
        f"wheel speed, measured minus momentum balance, rad/s; grey crosses: weight below {OUTLIER:g}", fontsize=10
    )
    axes.set_xlabel(_time_of(found), fontsize=9)
    axes.tick_params(labelsize=8)


def _told(axes: Axes, found: Identification) -> None:
    """Information by second: share of the information on each parameter per second, over its largest."""
    length = sum(float(flight.time[-1] - flight.time[0]) for flight in found.flights if len(flight.time) > 1)
    start, tables, edges = 0.0, [], []
    for flight in found.flights:
        if len(flight.time) < 2:
            continue
        span = float(flight.time[-1] - flight.time[0])
        bins = max(1, min(round(_STRIPS * span / length), len(flight.time) // 2))
        bounds = np.linspace(flight.time[0], flight.time[-1], bins + 1)
        which = np.clip(np.searchsorted(bounds, flight.time, side="right") - 1, 0, bins - 1)
        table = np.zeros((bins, 6))
        np.add.at(table, which, flight.told)
        tables.append(table / max(span / bins, 1e-300))
        edges.append(start + bounds - bounds[0])
        start += 1.02 * span
    known = np.array([parameter.determined for parameter in found.parameters[:6]])
    largest = np.max([table.max(axis=0) for table in tables], axis=0) if tables else np.ones(6)
    for table, bounds in zip(tables, edges, strict=True):
        shown = np.where(known, table / np.maximum(largest, 1e-300), np.nan)
        axes.pcolormesh(bounds, np.arange(7), shown.T, cmap="Blues", vmin=0.0, vmax=1.0)
    axes.set_yticks(np.arange(6) + 0.5, NAMES)
    axes.invert_yaxis()
    axes.set_title("information on each parameter by second; dark: most", fontsize=10)
    axes.set_xlabel(_time_of(found), fontsize=9)
    axes.tick_params(labelsize=8)


def _shares(axes: Axes, found: Identification) -> None:
    """Share of the information about each parameter, by flight."""
    left, names = np.zeros(6), [flight.name for flight in found.flights]
    for number, flight in enumerate(found.flights):
        share = np.clip(flight.share, 0.0, None)
        shade = 0.25 + 0.65 * (number % 6) / 6.0
        bars = axes.barh(
            NAMES, share, left=left, color=(0.0, 0.45 * shade + 0.2, 0.7 * shade + 0.25), edgecolor="white"
        )
        wide = [str(number + 1) if part > 0.03 else "" for part in share]
        axes.bar_label(bars, wide, label_type="center", color="white", fontsize=8)
        left = left + share
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.0)
    said = "; ".join(f"{k}: {name}" for k, name in enumerate(names[:_FLIGHTS_MAX], start=1))
    axes.set_title("share of what is known, by flight", fontsize=10)
    axes.set_xlabel(said if len(said) < 170 else said[:167] + "...", fontsize=8)
    axes.tick_params(labelsize=8)
