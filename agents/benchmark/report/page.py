"""Page of the report: results and curves in a template, with style, scripts and plotly, one file that is complete.

Files are read from `assets/`. The page asks for nothing from any network, and its content policy forbids it to.
"""

from __future__ import annotations

import html
import json
import string
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.benchmark.report.leaderboard import ALL_MODES, leaderboard
from agents.benchmark.report.looks import place
from agents.benchmark.results import file_names, files_of, read_curves, read_results
from agents.benchmark.stored import with_stored
from satid_gym.files import write_text
from satid_gym.metrics import BEYOND_MAX

ASSETS = Path(__file__).parent / "assets"
SCRIPTS = (
    "page.js",
    "choice.js",
    "leaderboard.js",
    "tradeoff.js",
    "charts.js",
    "heatmap.js",
    "episode.js",
    "flight.js",
    "sky.js",
    "main.js",
)
_SAME_RUN = ("command", "revision", "seeds", "settings")
_KEYS = {
    "results": (*_SAME_RUN, "versions", "records", "bounds", "efficiencies"),
    "curves": (*_SAME_RUN, "time", "curves", "bounds", "episode"),
}
_REMEDY = "run python -m agents.compare again"
_FIRST_SHOWN = ("mpc", "rate_square")  # next to the learned and the best scripted


def write_report(results: Mapping[str, Any], curves: Mapping[str, Any], folder: Path) -> Path:
    """Write what the page is made of beyond compare.json, and the page; the page's path."""
    names = files_of(results)
    made = {name: results[name] for name in _SAME_RUN}
    write_text(folder / names["curves"], json.dumps({**made, **curves}, allow_nan=False, separators=(",", ":")))
    write_text(folder / names["page"], page(results, curves))
    return folder / names["page"]


def rebuild(folder: Path, scenario: str, control: str = "torque") -> Path:
    """Make the page again from the files of a comparison; its path.

    Raises:
        FileNotFoundError: a file is missing.
        ValueError: a file is damaged, or they come from different comparisons.
    """
    names = file_names(scenario, control)
    for name in _KEYS:
        if not (folder / names[name]).is_file():
            raise FileNotFoundError(
                f"{folder / names[name]} is missing: run python -m agents.compare --scenario {scenario} "
                f"--control {control} --output {folder} first"
            )
    results = read_results(folder / names["results"], _REMEDY, keys=_KEYS["results"])
    curves = read_curves(folder / names["curves"], _REMEDY, keys=_KEYS["curves"])
    differ = [name for name in _SAME_RUN if results[name] != curves[name]]
    if differ:
        raise ValueError(
            f"{names['results']} and {names['curves']} come from different comparisons (not the same {differ[0]}): "
            f"{_REMEDY}"
        )
    write_text(folder / names["page"], page(results, curves))
    return folder / names["page"]


def page(results: Mapping[str, Any], curves: Mapping[str, Any]) -> str:
    """The page as HTML."""
    plotly = (ASSETS / "plotly-basic.min.js").read_text(encoding="utf-8")
    licence = (ASSETS / "plotly-LICENSE").read_text(encoding="utf-8")
    template = string.Template((ASSETS / "page.html").read_text(encoding="utf-8"))
    return template.substitute(
        scenario=html.escape(results["settings"]["scenario"]),
        style=(ASSETS / "page.css").read_text(encoding="utf-8"),
        flight=(ASSETS / "flight.html").read_text(encoding="utf-8"),
        plotly=f"/* plotly.js\n{licence}*/\n{plotly}",
        script="\n".join((ASSETS / name).read_text(encoding="utf-8") for name in SCRIPTS),
        data=json.dumps(page_data(results, curves), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
    )


def page_data(results: Mapping[str, Any], curves: Mapping[str, Any]) -> dict[str, Any]:
    """What the page's scripts read."""
    stored, results = results.get("stored"), with_stored(results)
    satellites, modes = results["settings"]["satellites"], results["settings"]["modes"]
    policies = {r["policy"]: r for r in results["records"]}
    return {
        "provenance": {name: results[name] for name in ("command", "revision", "seeds", "versions", "settings")},
        "stored": stored and {name: stored[name] for name in ("file", "revision", "notes")},
        "satellites": satellites,
        "modes": modes,
        "most_beyond": BEYOND_MAX,
        "policies": [
            {"name": name, "kind": r["kind"], "place": place(name), "stored": r.get("stored", False)}
            for name, r in policies.items()
        ],
        "shown": first_shown(results),
        "cells": {
            satellite: {mode: leaderboard(results, satellite, mode) for mode in (*modes, ALL_MODES)}
            for satellite in satellites
        },
        "time": curves["time"],
        "curves": curves["curves"],
        "bounds": curves["bounds"],
        "episode": curves["episode"],
    }


def first_shown(results: Mapping[str, Any]) -> list[str]:
    """Policies that the charts show before anything is switched: few enough to be told apart."""
    totals: dict[str, float] = {}
    flown = [r for r in results["records"] if not r.get("stored")]  # only these have curves
    for r in flown:
        totals[r["policy"]] = totals.get(r["policy"], 0.0) + r["final_error_mean"]
    kinds = {r["policy"]: r["kind"] for r in flown}
    scripted = [policy for policy, kind in kinds.items() if kind == "scripted"]
    best = [min(scripted, key=lambda policy: totals[policy])] if scripted else []
    learned = [policy for policy, kind in kinds.items() if kind == "learned"]
    chosen = [*learned, *(policy for policy in _FIRST_SHOWN if policy in kinds), *best]
    return chosen or sorted(totals, key=lambda policy: totals[policy])[:4]
