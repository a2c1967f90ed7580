"""One episode of two policies, live in the terminal: `python -m agents.watch POLICY --profile multi_step`.

Same truth, same noise. Ctrl-C ends it. Where the output is no terminal, it prints a line now and then instead.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import tyro
from rich.console import Console
from rich.live import Live

from agents.dashboard import dashboard, verdict
from agents.pilot import Pairing, Pilot
from baselines.ending import ended, refusal
from satid_gym.config import check_number

_LINES = 10  # in an episode, where the output is no terminal


@dataclass(frozen=True, kw_only=True)
class Watch:
    """What to watch."""

    pairing: Annotated[Pairing, tyro.conf.arg(name="")]
    speed: float = 12.0
    """How many times faster than real."""


def draws(console: Console) -> bool:
    """Whether the output can show a moving picture."""
    return console.is_terminal and not console.is_dumb_terminal and console.encoding.lower().startswith("utf")


def watch(pilots: Sequence[Pilot], title: str, speed: float, console: Console) -> None:
    """Fly until both episodes are over, and show it.

    Args:
        pilots: two, at the start of their episodes.
        title: of the episode.
        speed: seconds of the episode in a second; where the console is no terminal it flies at full speed.
        console: to write to.
    """
    if draws(console):
        _show(pilots, title, speed, console)
    else:
        _tell(pilots, title, console)


def _show(pilots: Sequence[Pilot], title: str, speed: float, console: Console) -> None:
    period = pilots[0].env.problem.scenario.decision_period / speed
    with Live(dashboard(pilots, title, console.width), console=console, auto_refresh=False) as live:
        due = time.monotonic()
        while not _over(pilots):
            _step(pilots)
            due += period
            ahead = due - time.monotonic()
            if ahead > 0.0 or _over(pilots):  # a slow terminal gets fewer pictures, not a slower episode
                live.update(dashboard(pilots, title, console.width), refresh=True)
                time.sleep(max(0.0, due - time.monotonic()))


def _tell(pilots: Sequence[Pilot], title: str, console: Console) -> None:
    scenario = pilots[0].env.problem.scenario
    every = max(1, scenario.decisions // _LINES)
    console.print(title, highlight=False)
    decision = 0
    while not _over(pilots):
        _step(pilots)
        decision += 1
        if decision % every == 0 or _over(pilots):
            states = " | ".join(
                f"{pilot.name}: error {100 * pilot.error:.3f} %, outside limits {100 * pilot.outside:.1f} %"
                for pilot in pilots
            )
            console.print(f"{decision * scenario.decision_period:5.0f} s | {states}", highlight=False, soft_wrap=True)
    console.print(verdict(pilots), highlight=False, soft_wrap=True)


def _over(pilots: Sequence[Pilot]) -> bool:
    return all(pilot.over for pilot in pilots)


def _step(pilots: Sequence[Pilot]) -> None:
    for pilot in pilots:
        pilot.step()


def main() -> int:
    """Show what the command line asks for; the exit code."""
    settings = tyro.cli(Watch, description=__doc__)
    pairing = settings.pairing
    with refusal():
        check_number("speed", settings.speed, strict=True)
        pilots, title = pairing.pilots(), pairing.title
    console = Console()
    try:
        watch(pilots, title, settings.speed, console)
    finally:
        console.show_cursor()  # rich does so as well, unless Ctrl-C came as it was about to begin
    return 0


if __name__ == "__main__":
    sys.exit(ended(main, "run it again to see the rest"))
