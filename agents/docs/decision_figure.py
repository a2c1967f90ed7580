"""Diagram of one decision, truth left of the wall and belief right of it: `python -m agents.docs.decision_figure`.

Writes docs/media/decision.svg.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.docs.readme import ROOT
from baselines.command import cli
from satid_gym.files import check_writable

_TRUTH, _BELIEF, _EDGE = "#fbe9d7", "#dcebf7", "#33404d"
_BOXES = {  # name: (x, y of the centre, width, title, text)
    "wheels": (1.55, 3.55, 2.3, "wheels", "torque and speed\nlimits, noise"),
    "body": (4.45, 3.55, 2.5, "body", "momentum $M$,\ntrue inertia $J(t)$"),
    "sensors": (7.3, 3.55, 2.2, "sensors", "gyro, tachometers,\n10 a second"),
    "world": (4.45, 5.25, 2.5, "world", "inertia law,\nexternal torque"),
    "filter": (10.75, 3.55, 2.5, "filter", "estimate $\\hat\\theta$,\ncovariance $P$"),
    "prior": (10.75, 5.25, 2.5, "prior", "what is known\nbefore launch"),
    "reward": (14.2, 4.5, 2.7, "reward", "nats since launch,\nless penalties"),
    "observation": (14.2, 2.6, 2.7, "observation", "readings, $\\hat\\theta$, $P$,\ntime left"),
    "policy": (10.75, 0.75, 2.5, "policy", "yours"),
    "info": (4.45, 1.75, 2.5, "info", "for evaluation only"),
}
_HALF = 0.52  # of a box's height


@dataclass(frozen=True, kw_only=True)
class Figure:
    """The file to write."""

    output: Path = ROOT / "docs" / "media" / "decision.svg"
    """The picture; its ending says the format, .svg or .png."""


def draw(output: Path) -> None:
    """Write the diagram.

    Raises:
        OSError: the file cannot be written.
    """
    import matplotlib  # of the extra dev
    from matplotlib.figure import Figure as Canvas
    from matplotlib.patches import Rectangle

    with matplotlib.rc_context({"svg.hashsalt": "satid-gym", "font.family": "DejaVu Sans"}):
        canvas = Canvas(figsize=(9.2, 3.77), facecolor="white")
        axes = canvas.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 16.0), ylim=(0.0, 6.55))
        axes.set_axis_off()
        axes.add_patch(Rectangle((0.15, 0.1), 8.6, 6.35, facecolor=_TRUTH, linewidth=0))
        axes.add_patch(Rectangle((9.0, 0.1), 6.85, 6.35, facecolor=_BELIEF, linewidth=0))
        axes.add_patch(Rectangle((8.75, 0.1), 0.25, 6.35, facecolor="#6b747d", linewidth=0, zorder=1))
        axes.text(8.87, 5.4, "wall", rotation=90, color="white", fontsize=9, ha="center", va="center")
        axes.text(0.4, 6.1, "TRUTH", fontsize=10, weight="bold", color=_EDGE, va="center")
        axes.text(15.6, 6.1, "BELIEF", fontsize=10, weight="bold", color=_EDGE, va="center", ha="right")
        for name in _BOXES:
            _box(axes, name)
        for start, end, label in (
            ("wheels", "body", "torque"),
            ("body", "sensors", "rate"),
            ("sensors", "filter", ""),
        ):
            _arrow(axes, _side(start, 1), _side(end, -1), label)
        for start, end in (("world", "body"), ("prior", "filter")):
            _arrow(axes, _end(start, -1), _end(end, 1))
        for end in ("reward", "observation"):
            _arrow(axes, _side("filter", 1), _side(end, -1))
        _arrow(axes, _end("body", -1), _end("info", 1), dashed=True)
        _turn(axes, [_end("observation", -1), (14.2, 0.75), _side("policy", 1)])
        _turn(axes, [_side("policy", -1), (1.55, 0.75), _end("wheels", -1)])
        axes.text(6.4, 0.9, "action, once a second, held", fontsize=9, ha="center", va="bottom", color=_EDGE)
        kind = {"Date": None} if output.suffix == ".svg" else {}
        canvas.savefig(output, dpi=110, facecolor="white", metadata=kind)


def _box(axes: Any, name: str) -> None:
    from matplotlib.patches import FancyBboxPatch

    x, y, width, title, text = _BOXES[name]
    style = "--" if name == "info" else "-"
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2.0, y - _HALF), width, 2.0 * _HALF, boxstyle="round,pad=0,rounding_size=0.12",
            facecolor="white", edgecolor=_EDGE, linewidth=1.1, linestyle=style, zorder=3,
        )
    )  # fmt: skip
    one_line = "\n" not in text
    axes.text(
        x, y + (0.17 if one_line else 0.29), title, fontsize=10, weight="bold", ha="center", va="center", zorder=4
    )
    axes.text(
        x, y - (0.18 if one_line else 0.17), text, fontsize=8.5, ha="center", va="center", zorder=4, linespacing=1.15
    )


def _side(name: str, way: int) -> tuple[float, float]:
    x, y, width, *_ = _BOXES[name]
    return x + way * width / 2.0, y


def _end(name: str, way: int) -> tuple[float, float]:
    x, y, *_ = _BOXES[name]
    return x, y + way * _HALF


def _arrow(
    axes: Any, start: tuple[float, float], end: tuple[float, float], label: str = "", dashed: bool = False
) -> None:
    look = {"arrowstyle": "-|>", "color": _EDGE, "lw": 1.3, "shrinkA": 0, "shrinkB": 0, "ls": "--" if dashed else "-"}
    axes.annotate("", end, start, arrowprops=look, zorder=2)
    if label:
        middle = (start[0] + end[0]) / 2.0
        axes.text(middle, start[1] + 0.62, label, fontsize=8, ha="center", va="bottom", color=_EDGE, zorder=5)


def _turn(axes: Any, corners: list[tuple[float, float]]) -> None:
    xs, ys = zip(*corners[:-1], strict=True)
    axes.plot(xs, ys, color=_EDGE, lw=1.3, zorder=2)
    _arrow(axes, corners[-2], corners[-1])


def main(figure: Figure) -> int:
    """Draw the figure that the command line asks for; the exit code."""
    check_writable(figure.output.parent)
    draw(figure.output)
    print(f"{figure.output} written")
    return 0


if __name__ == "__main__":
    cli.run(main)
