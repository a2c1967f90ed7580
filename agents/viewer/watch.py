"""Live terminal view of one episode of two policies: `python -m agents.watch POLICY --against multi_step`.

Both fly with the same truth and noise. Ctrl-C ends it. If the output is not a terminal, ten lines are printed.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import tyro
from rich.console import Console
from rich.live import Live

from agents.viewer.dashboard import dashboard, summary
from agents.viewer.rollout import Pairing, Rollout
from baselines.command import cli
from satid_gym.config import check_number

_LINES = 10  # per episode, if the output is not a terminal


@dataclass(frozen=True, kw_only=True)
class WatchSettings:
    """Settings of the live view."""

    pairing: Annotated[Pairing, tyro.conf.arg(name="")]
    speed: float = 12.0
    """Speed: seconds of the episode per second."""


def draws(console: Console) -> bool:
    """Whether the console can show the dashboard."""
    return console.is_terminal and not console.is_dumb_terminal and console.encoding.lower().startswith("utf")


def watch(rollouts: Sequence[Rollout], title: str, speed: float, console: Console) -> None:
    """Fly both episodes to their end and show them.

    Args:
        rollouts: two, at the start of their episodes.
        title: of the episode.
        speed: seconds of the episode per second; without effect if the console is not a terminal.
        console: output.
    """
    if draws(console):
        _show_dashboard(rollouts, title, speed, console)
    else:
        _print_lines(rollouts, title, console)


def _show_dashboard(rollouts: Sequence[Rollout], title: str, speed: float, console: Console) -> None:
    period = rollouts[0].env.problem.scenario.decision_period / speed
    with Live(dashboard(rollouts, title, console.width), console=console, auto_refresh=False) as live:
        due = time.monotonic()
        while not _over(rollouts):
            _step(rollouts)
            due += period
            ahead = due - time.monotonic()
            if ahead > 0.0 or _over(rollouts):  # a slow terminal gets fewer pictures, not a slower episode
                live.update(dashboard(rollouts, title, console.width), refresh=True)
                time.sleep(max(0.0, due - time.monotonic()))


def _print_lines(rollouts: Sequence[Rollout], title: str, console: Console) -> None:
    scenario = rollouts[0].env.problem.scenario
    every = max(1, scenario.decisions // _LINES)
    console.print(title, highlight=False)
    decision = 0
    while not _over(rollouts):
        _step(rollouts)
        decision += 1
        if decision % every == 0 or _over(rollouts):
            states = " | ".join(
                f"{rollout.name}: error {100 * rollout.error:.3f} %, outside rate limit {100 * rollout.outside:.1f} %"
                + (f", {rollout.ending}" if rollout.ending else "")
                for rollout in rollouts
            )
            console.print(f"{decision * scenario.decision_period:5.0f} s | {states}", highlight=False, soft_wrap=True)
    console.print(summary(rollouts), highlight=False, soft_wrap=True)


def _over(rollouts: Sequence[Rollout]) -> bool:
    return all(rollout.over for rollout in rollouts)


def _step(rollouts: Sequence[Rollout]) -> None:
    for rollout in rollouts:
        rollout.step()


@cli.on_interrupt("run it again to see the rest")
def main(settings: WatchSettings) -> int:
    """Show the episode of the command line; returns the exit code."""
    pairing = settings.pairing
    with cli.user_errors():
        check_number("speed", settings.speed, strict=True)
        rollouts, title = pairing.rollouts(), pairing.title
    console = Console()
    try:
        watch(rollouts, title, settings.speed, console)
    finally:
        console.show_cursor()  # rich does this too, unless Ctrl-C came before its display started
    return 0
