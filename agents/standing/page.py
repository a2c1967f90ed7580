"""Page of the standing table: one file that is complete; see `agents.benchmark.report.page`."""

from __future__ import annotations

import json
import string
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.benchmark.report.looks import place
from agents.benchmark.report.page import ASSETS as SHARED
from agents.standing.summary import RUNGS
from satid_gym.files import write_text

ASSETS = Path(__file__).parent / "assets"
_SHARED_SCRIPTS = ("page.js", "tradeoff.js", "heatmap.js", "flight.js", "sky.js", "episode.js")
_LEFT_OUT = ("settings", "revision")  # of a row, which the page does not show


def write_page(values: Mapping[str, Any], episodes: Mapping[str, Any], folder: Path) -> Path:
    """Write standing.html; its path.

    Args:
        values: as standing.json has them.
        episodes: by scenario, see `agents.standing.replay`.
        folder: where to.
    """
    path = folder / "standing.html"
    write_text(path, page(values, episodes))
    return path


def page(values: Mapping[str, Any], episodes: Mapping[str, Any]) -> str:
    """The page as HTML."""

    def text(folder: Path, name: str) -> str:
        return (folder / name).read_text(encoding="utf-8")

    template = string.Template(text(ASSETS, "standing.html"))
    scripts = [*(text(SHARED, name) for name in _SHARED_SCRIPTS), text(ASSETS, "standing.js")]
    return template.substitute(
        style=text(SHARED, "page.css"),
        flight=text(SHARED, "flight.html"),
        plotly=f"/* plotly.js\n{text(SHARED, 'plotly-LICENSE')}*/\n{text(SHARED, 'plotly-basic.min.js')}",
        script="\n".join(scripts),
        data=json.dumps(page_data(values, episodes), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
    )


def page_data(values: Mapping[str, Any], episodes: Mapping[str, Any]) -> dict[str, Any]:
    """What the page's scripts read."""
    kinds = {r["policy"]: r["kind"] for r in values["rows"]}
    return {
        "provenance": {name: values[name] for name in ("command", "revision", "seeds", "versions", "settings")},
        "revisions": sorted({r["revision"] for r in values["rows"]}),
        "most_beyond": values["settings"]["cost"],
        "policies": [{"name": name, "kind": kind, "place": place(name)} for name, kind in kinds.items()],
        "rungs": RUNGS,
        "ladders": values["ladders"],
        "left_out": values["left_out"],
        "rows": [{k: v for k, v in r.items() if k not in _LEFT_OUT} for r in values["rows"]],
        "episodes": episodes,
    }
