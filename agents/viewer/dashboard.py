"""Terminal dashboard of two rollouts side by side: rates, wheel speeds, inertia estimate and its cost."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from agents.viewer.rollout import Rollout

AXES = ("#ff8a65", "#5ed9a5", "#6caaff")  # x, y, z, as in the rendered frames
_BLOCKS = " ▁▂▃▄▅▆▇█"
_LOG_RANGE = (-4.3, -0.5)  # log10 of the relative errors and standard deviations in sparklines
_BAR_MAX = 1.25  # multiples of the limit at the ends of a bar
_LABEL_WIDTH = 8  # characters left of a bar or sparkline
_VALUE_WIDTH = 9  # characters right of it
_WIDTH_MIN, _WIDTH_MAX = 76, 132


def sparkline(values: Sequence[float], length: int, width: int) -> str:
    """Line of `width` characters for values over an episode of `length` entries, on a logarithmic scale.

    Each character stands for the largest value in its share of the episode; the part still to come is blank.
    """
    edges = np.linspace(0, length, width + 1).round().astype(int)
    line = ""
    for low, high in itertools.pairwise(edges):
        part = np.log10(np.maximum(values[low : max(high, low + 1)], 1e-12))
        if len(part) == 0:
            return line.ljust(width)
        share = (part.max() - _LOG_RANGE[0]) / (_LOG_RANGE[1] - _LOG_RANGE[0])
        line += _BLOCKS[1 + int(np.clip(share * 8.0, 0.0, 7.0))]
    return line


def bar(value: float, width: int, colour: str) -> Text:
    """Bar from the middle to `value`, in multiples of a limit; with ticks at the limits, red beyond them."""
    cells = np.linspace(-_BAR_MAX, _BAR_MAX, width)
    ticks = {int(np.abs(cells - limit).argmin()) for limit in (-1.0, 1.0)}
    middle = width // 2
    tip = int(np.abs(cells - np.clip(value, -_BAR_MAX, _BAR_MAX)).argmin())
    filled = range(min(middle, tip), max(middle, tip) + 1)
    text = Text()
    for i in range(width):
        if i in filled:
            text.append("■", "bold red" if abs(value) > 1.0 else colour)
        else:
            text.append("│" if i in ticks else "·" if i != middle else "┼", "red" if i in ticks else "grey37")
    return text


def dashboard(rollouts: Sequence[Rollout], title: str, width: int) -> RenderableType:
    """Present state of both rollouts.

    Args:
        rollouts: two, at the same decision.
        title: of the episode.
        width: of the terminal, in characters.
    """
    width = min(max(width, _WIDTH_MIN), _WIDTH_MAX)
    table = Table.grid(expand=False, padding=0)
    for _ in rollouts:
        table.add_column(width=width // 2)
    table.add_row(*(_panel(rollout, width // 2) for rollout in rollouts))
    return Group(_head(rollouts[0], title, width), table, _summary(rollouts))


def _head(rollout: Rollout, title: str, width: int) -> Text:
    scenario = rollout.env.problem.scenario
    time, horizon = rollout.info["time"], scenario.horizon
    clock = f" {time:.0f} of {horizon:.0f} s"
    length = max(8, width - len(title) - len(clock) - 3)
    done = round(length * min(1.0, time / horizon))
    return Text.assemble((f" {title} ", "bold"), ("━" * done, "cyan"), ("━" * (length - done), "grey37"), clock)


def _panel(rollout: Rollout, width: int) -> Panel:
    length = width - 4 - _LABEL_WIDTH - _VALUE_WIDTH
    history, count = rollout.history, rollout.env.problem.scenario.decisions + 1
    rows = Table.grid(padding=0)
    rows.add_column(width=_LABEL_WIDTH)
    rows.add_column(width=length)
    rows.add_column(width=_VALUE_WIDTH, justify="right")
    heading = "grey62"
    rows.add_row("", Text("relative error", heading), "")
    errors = sparkline(history["relative_error"], count, length)
    rows.add_row(Text("J", "bold"), Text(errors, "bold yellow"), _percent(rollout.error, "bold yellow"))
    rows.add_row("", Text("sigma by filter", heading), "")
    for i, axis in enumerate(("xx", "yy", "zz")):
        std = [entry[i] for entry in history["std"]]
        rows.add_row(f"J{axis}", Text(sparkline(std, count, length), AXES[i]), _percent(std[-1], AXES[i]))
    for name, title, label in (("rate", "body rate / limit", "axis"), ("wheel_speed", "speed / limit", "wheel")):
        rows.add_row("", Text(title, heading), "")
        for i, value in enumerate(history[name][-1]):
            number = Text(f"{value:+.2f}", "bold red" if abs(value) > 1.0 else "")
            rows.add_row(f"{label} {'xyz'[i] if name == 'rate' else i + 1}", bar(value, length, AXES[i % 3]), number)
    information = Text(f"gained {history['information'][-1]:.0f} nats")
    outside = Text(f"outside {100 * rollout.outside:.1f} %", "bold red" if rollout.history["outside"][-1] > 0.0 else "")
    foot = Table.grid(expand=True)
    foot.add_column()
    foot.add_column(justify="right")
    foot.add_row(information, outside)
    state = f" {rollout.ending or rollout.policy.kind.replace('_', ' ')} "
    return Panel(
        Group(rows, foot), title=Text(f" {rollout.name} ", "bold cyan"), subtitle=state, box=box.ROUNDED, width=width,
        border_style="red" if rollout.terminated else "grey50",
    )  # fmt: skip


def _percent(share: float, style: str) -> Text:
    digits = 3 if share < 0.01 else 2 if share < 0.1 else 1
    return Text(f"{100 * share:.{digits}f} %", style)


def _summary(rollouts: Sequence[Rollout]) -> Text:
    return Text(f" {summary(rollouts)}", "bold", no_wrap=True, overflow="ellipsis")


def summary(rollouts: Sequence[Rollout]) -> str:
    """One line that compares the mean errors."""
    best = min(rollout.mean_error for rollout in rollouts)
    parts = [
        f"{rollout.name} {100 * rollout.mean_error:.3f} %"
        + (f" ({rollout.mean_error / best:.1f} times larger)" if rollout.mean_error > best else "")
        for rollout in rollouts
    ]
    return f"mean error: {', '.join(parts)}"
