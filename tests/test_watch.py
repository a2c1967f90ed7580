"""The live view in a terminal."""

from __future__ import annotations

import io
import os
import re
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from rich.console import Console

from agents.viewer import watch
from agents.viewer.dashboard import bar, dashboard, sparkline, summary
from agents.viewer.rollout import Pairing
from baselines.command.cli import exit_code
from tests.cases import cases
from tests.qa.interruption import heed_interrupts

PAIRING = Pairing(policy="generalist", horizon=20.0)
TITLE = "microsat, step inertia"


def terminal(width: int = 100, **settings) -> Console:
    return Console(file=io.StringIO(), width=width, height=24, force_terminal=True, record=True, **settings)


def shown(rollouts, width: int = 100) -> str:
    console = terminal(width)
    console.print(dashboard(rollouts, TITLE, width))
    return console.export_text()


def numbers(text: str, label: str) -> list[float]:
    """The number that ends each panel's row of this label."""
    (line,) = [line for line in text.splitlines() if label in line]
    return [float(number) for number in re.findall(r"([-+]?\d+\.\d+)(?: %)? *│", line)]


def test_a_sparkline_shows_falls_and_the_time_left():
    line = sparkline([0.3, 0.03, 0.003, 0.00005], 8, 8)
    assert len(line) == 8
    assert line.endswith("    ")
    heights = [" ▁▂▃▄▅▆▇█".index(character) for character in line[:4]]
    assert heights == sorted(heights, reverse=True)
    assert heights[0] == 8
    assert heights[-1] == 1
    assert len(sparkline(np.full(301, 0.01), 301, 27).strip()) == 27
    assert sparkline([0.3, *[1e-3] * 9], 10, 1) == "█"  # the largest


def test_a_bar_points_to_its_value():
    for value in (-0.9, -0.3, 0.4, 1.1):
        text = bar(value, 41, "green").plain
        filled = [i for i, character in enumerate(text) if character == "■"]
        low, high = sorted((20, 20 + round(16 * value)))
        assert (filled[0], filled[-1]) == (pytest.approx(low, abs=1), pytest.approx(high, abs=1))
        assert len(text) == 41
    styles = {str(span.style) for span in bar(1.1, 41, "green").spans}
    assert "bold red" in styles
    assert "green" not in styles


def test_the_view_is_the_state():
    rollouts = PAIRING.rollouts()
    before = shown(rollouts)
    for _ in range(20):
        for rollout in rollouts:
            rollout.step()
    after = shown(rollouts)
    assert "0 of 20 s" in before
    assert "20 of 20 s" in after
    for label, key, index in (("axis y", "rate", 1), ("wheel 3", "wheel_speed", 2)):
        state = [rollout.history[key][-1][index] for rollout in rollouts]
        assert numbers(after, label) == pytest.approx(state, abs=0.0051)
        assert numbers(before, label) != numbers(after, label)
    std = [100.0 * rollout.history["std"][-1][2] for rollout in rollouts]
    assert numbers(after, "Jzz") == pytest.approx(std, abs=0.051)
    assert max(std) < 0.3 * min(numbers(before, "Jzz"))
    assert f"{100 * rollouts[0].error:.3f} %" in after
    assert f"gained {rollouts[1].history['information'][-1]:.0f} nats" in after
    assert f"outside {100 * rollouts[0].outside:.1f} %" in after
    assert summary(rollouts) in after


def test_the_verdict_names_the_better():
    rollouts = PAIRING.rollouts()
    for rollout, error in zip(rollouts, (0.04, 0.01), strict=True):
        rollout.history["relative_error"][:] = [0.3, error]
    assert summary(rollouts) == "mean error: generalist 4.000 % (4.0 times larger), multi_step 1.000 %"


@pytest.mark.parametrize("width", [76, 80, 100, 200])
def test_the_view_fits_a_terminal(width):
    rollouts = PAIRING.rollouts()
    lines = shown(rollouts, width).rstrip("\n").splitlines()
    assert len(lines) <= 23
    assert max(map(len, lines)) <= width


def test_it_plays_to_the_end_in_a_terminal():
    console = terminal()
    rollouts = PAIRING.rollouts()
    watch.watch(rollouts, TITLE, 1e6, console)
    text = console.export_text()
    assert all(rollout.over for rollout in rollouts)
    assert "20 of 20 s" in text
    assert summary(rollouts) in text


def test_speed_is_kept():
    start = time.perf_counter()
    watch.watch(PAIRING.rollouts(), TITLE, 40.0, terminal())
    assert 0.5 <= time.perf_counter() - start < 2.0


def test_an_early_end_is_told_where_it_ends():
    rollouts = Pairing(policy="generalist", against="random", inertia="static").rollouts()
    file = io.StringIO()
    watch.watch(rollouts, TITLE, 1.0, Console(file=file, width=60))
    ended = rollouts[1]
    assert ended.terminated
    said = f"ended at {ended.info['time']:g} s: a body rate beyond 3 times its limit"
    after = [line for line in file.getvalue().splitlines() if "random: error" in line]
    assert [line.endswith(said) for line in after] == [
        float(line.split(" s |")[0]) >= ended.info["time"] for line in after
    ]
    assert said[:30] in shown(rollouts)


@pytest.mark.parametrize("kind", ["a file", "dumb", "ascii"])
def test_without_a_terminal_it_prints_lines(kind, monkeypatch):
    if kind == "dumb":
        monkeypatch.setenv("TERM", "dumb")
    buffer = io.BytesIO()
    file = io.TextIOWrapper(buffer, encoding="ascii" if kind == "ascii" else "utf-8")
    console = Console(file=file, width=60, force_terminal=kind != "a file")
    assert not watch.draws(console)
    rollouts = PAIRING.rollouts()
    watch.watch(rollouts, TITLE, 1.0, console)  # and does not wait
    file.flush()
    lines = buffer.getvalue().decode("ascii").splitlines()
    assert len(lines) == 12
    assert [float(line.split(" s |")[0]) for line in lines[1:-1]] == list(range(2, 21, 2))
    for rollout in rollouts:
        assert f"{rollout.name}: error {100 * rollout.error:.3f} %" in lines[-2]
    assert lines[-1] == summary(rollouts)


@cases(
    ("arguments", "message"),
    [(("nobody",), "unknown policy"), (("generalist", "--speed", "0"), "speed must be finite and more than 0")],
)
def test_errors_are_said(monkeypatch, capsys, arguments, message):
    monkeypatch.setattr(sys, "argv", ["watch", *arguments])
    assert exit_code(watch.main) == 2
    assert message in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo-terminal")
def test_ctrl_c_ends_it_cleanly():
    outer, inner = os.openpty()
    command = [sys.executable, "-m", "agents.watch", "generalist", "--against", "multi_step", "--speed", "1"]
    settings = {"stdout": inner, "stderr": inner, "env": {**os.environ, "TERM": "xterm"}}
    with subprocess.Popen(command, preexec_fn=heed_interrupts, **settings) as process:
        os.close(inner)
        text, sent = b"", False
        until = time.monotonic() + 120.0
        while time.monotonic() < until:
            if not select.select([outer], [], [], 0.2)[0]:
                continue
            try:
                text += os.read(outer, 65536)
            except OSError:  # how Linux says that the other side is closed
                break
            if b"of 300 s" in text and not sent:
                process.send_signal(signal.SIGINT)
                sent = True
        assert process.wait(timeout=60) == 130
    os.close(outer)
    assert b"stopped" in text
    assert b"Traceback" not in text
    assert text.rfind(b"\x1b[?25h") > text.rfind(b"\x1b[?25l")  # the cursor is back
