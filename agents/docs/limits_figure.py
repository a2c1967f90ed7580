"""Figure of the errors that policies reach and of what each cell allows: `python -m agents.docs.limits_figure`.

Reads docs/results/compare.json and writes docs/media/limits.png.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.benchmark.summary.ranking import cells, standings
from agents.docs.readme import REMEDY, RESULTS, ROOT
from agents.docs.results_tables import source
from baselines.command import cli
from baselines.command.markdown import table
from satid_gym.files import check_writable, read_json

_SHOWN = {  # policy: marker, colour
    "generalist": ("*", "#d55e00"),
    "ppo": ("P", "#cc79a7"),
    "mpc": ("D", "#0072b2"),
    "rate_square": ("s", "#56b4e9"),
    "best of the paper's eight": ("o", "#009e73"),
    "zero": ("X", "#5a636d"),
}


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Results to draw, and the file to write."""

    results: Path = RESULTS / "compare.json"
    """File that agents.compare wrote, with bounds."""
    output: Path = ROOT / "docs" / "media" / "limits.png"
    """The picture, .png."""


def points(results: Mapping[str, Any]) -> list[tuple[str, str, str, float]]:
    """(satellite, inertia mode, name, final error) of everything that is drawn."""
    found = [(b["satellite"], b["inertia_mode"], b["policy"], b["final_error"]) for b in results["bounds"]]
    errors = {(r["satellite"], r["inertia_mode"], r["policy"]): r["final_error_mean"] for r in results["records"]}
    found += [(*cell, policy, error) for (*cell, policy), error in errors.items() if policy in _SHOWN]
    learned = next(r["policy"] for r in results["records"] if r["kind"] == "learned")
    best = "best of the paper's eight"
    found += [
        (s.satellite, s.mode, best, errors[s.satellite, s.mode, s.profile])
        for s in standings(results, learned)
        if s.profile
    ]
    return found


def share_table(results: Mapping[str, Any]) -> str:
    """Ranges over the cells: error of doing nothing over the policy's error, and limit over the policy's error in %."""
    errors = {(r["satellite"], r["inertia_mode"], r["policy"]): r["final_error_mean"] for r in results["records"]}
    rows = []
    for policy in (p for p in _SHOWN if any(p == r["policy"] for r in results["records"]) and p != "zero"):
        ratios = [errors[s, m, "zero"] / error for (s, m, p), error in errors.items() if p == policy]
        share = [100.0 * e["excitation_efficiency"] for e in results["efficiencies"] if e["policy"] == policy]
        rows.append([policy, *(f"{min(values):.0f} to {max(values):.0f}" for values in (ratios, share))])
    return "\n\n".join(
        [table(["policy", "error of `zero` / error", "reference limit / error, %"], rows), source(results)]
    )


def draw(results: Mapping[str, Any], output: Path) -> None:
    """Write the picture: a panel for each satellite.

    Raises:
        OSError: the file cannot be written.
    """
    from matplotlib.figure import Figure as Canvas  # of the extra dev
    from matplotlib.ticker import FuncFormatter

    shown = points(results)
    places = [(cell[0]["satellite"], cell[0]["inertia_mode"]) for cell in cells(results["records"])]
    satellites, modes = (list(dict.fromkeys(place[i] for place in places)) for i in (0, 1))
    canvas = Canvas(figsize=(10.5, 4.4), layout="constrained")
    panels = canvas.subplots(1, len(satellites), sharey=True)
    names = list(_SHOWN)
    for panel, satellite in zip(panels, satellites, strict=True):
        for here, mode, name, error in shown:
            if here != satellite:
                continue
            x = float(modes.index(mode))
            if name in _SHOWN:
                marker, colour = _SHOWN[name]
                x += 0.13 * (names.index(name) - (len(names) - 1) / 2.0)
                size = 110 if marker == "*" else 45
                panel.scatter(x, 100.0 * error, s=size, marker=marker, color=colour, edgecolors="white", zorder=3)
            else:
                style = "-" if name == "bound" else "--"
                panel.plot([x - 0.4, x + 0.4], [100.0 * error] * 2, style, color="black", linewidth=1.4)
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.set_xticks(range(len(modes)), modes)
        panel.set_title(satellite, fontsize=11)
        panel.grid(axis="y", alpha=0.25)
    panels[0].set_ylabel("final error, %")
    canvas.legend(handles=_keys(), loc="outside lower center", ncols=4, frameon=False)
    canvas.savefig(output, dpi=110, metadata={"Source": _source(results), "Software": None})


def _source(results: Mapping[str, Any]) -> str:
    return f"{results['command']}, revision {results['revision']}"


def _keys() -> list[Any]:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], color="black", linestyle="-", label="bound"),
        Line2D([], [], color="black", linestyle="--", label="reference limit: best filter, every sample worth most"),
    ]
    return lines + [
        Line2D([], [], marker=marker, linestyle="", color=colour, markersize=8, label=name)
        for name, (marker, colour) in _SHOWN.items()
    ]


def main(figure: Figure) -> int:
    """Draw the figure that the command line asks for; the exit code."""
    check_writable(figure.output.parent)
    results = read_json(figure.results, REMEDY, keys=("records", "pairs", "bounds", "revision", "command"))
    draw(results, figure.output)
    print(f"{figure.output} written")
    return 0


if __name__ == "__main__":
    cli.run(main)
