"""Kill a training again and again, and see that nothing is lost: `python -m tests.qa.interruption --kills 20`.

A short training of the real command runs undisturbed; the same training is then killed at random moments (SIGKILL, and
SIGINT every other time with --signal both) and resumed until it ends. The policy's files, the learning curve and all
that the checkpoint holds must be the same bit for bit, but for the seconds that were measured. The exit code is 1
where they are not.
"""

from __future__ import annotations

import csv
import io
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from baselines.command import cli
from satid_gym.config import check_integer

ROOT = Path(__file__).parents[2]
PROMPT = 30.0  # s within which Ctrl-C has to end a run, on a machine that does a dozen other things as well
POLICY = ("policy", "last")
LAST = "timing.json"  # is written when all else is
RUNS = ("first", "whole", "killed")
SIGNALS = {
    "kill": (signal.SIGKILL, signal.SIGKILL),
    "int": (signal.SIGINT, signal.SIGINT),
    "both": (signal.SIGKILL, signal.SIGINT),
}


@dataclass(frozen=True, kw_only=True)
class Interruptions:
    """What to do to a training."""

    kills: int = 20
    """How often to stop it."""
    signal: Literal["kill", "int", "both"] = "kill"
    """How: SIGKILL, SIGINT (Ctrl-C), or by turns."""
    seed: int = 0
    """Of the moments."""
    steps: int = 96_000
    """Decisions of the training."""
    every: int = 3_200
    """Decisions between its checkpoints."""
    folder: Path | None = None
    """Where the runs go; a temporary folder that is removed by default."""

    def check(self) -> None:
        """Refuse what cannot be trained and stopped.

        Raises:
            ValueError: a number is out of range, or the folder holds such runs already.
        """
        check_integer("kills", self.kills)
        check_integer("every", self.every)
        check_integer("steps", self.steps, low=self.every)
        for name in RUNS:
            if self.folder is not None and (self.folder / name).exists():
                raise ValueError(f"{self.folder / name} exists already: remove it, or choose another --folder")


def training(settings: Interruptions, run: Path) -> list[str]:
    """The training's command line, without Python."""
    size = ["--num-envs", "32", "--rollout", "50", "--batch-size", "400", "--evaluation-episodes", "2"]
    length = ["--steps", str(settings.steps), "--evaluate-every", str(settings.every)]
    return ["-m", "agents.train", "--run", str(run), "--satellite", "microsat", *size, *length]


def resumption(settings: Interruptions, run: Path) -> list[str]:
    """How the training goes on, whatever it was that stopped it."""
    started = (run / "run.json").exists()
    return ["-m", "agents.train", "--run", str(run), "--resume"] if started else training(settings, run)


def start(arguments: list[str]) -> subprocess.Popen[str]:
    """A process of its own with its output kept."""
    command = [sys.executable, *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.Popen(command, cwd=ROOT, text=True, preexec_fn=heed_interrupts, **pipes)


def heed_interrupts() -> None:
    """What a child calls first: a shell's background jobs ignore Ctrl-C, and so would theirs."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def finish(arguments: list[str]) -> float:
    """Run to the end; the seconds it took.

    Raises:
        RuntimeError: it failed.
    """
    began = time.perf_counter()
    process = start(arguments)
    output, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f"{' '.join(arguments)} ended with {process.returncode}:\n{output}")
    return time.perf_counter() - began


def stop(process: subprocess.Popen[str], by: signal.Signals) -> list[str]:
    """Stop a process that runs; what is wrong with how it ended."""
    process.send_signal(by)
    began = time.perf_counter()
    output, _ = process.communicate()
    took = time.perf_counter() - began
    if by == signal.SIGKILL:
        return []
    wrong = []
    if process.returncode != 130 or "Traceback" in output:
        wrong.append(f"Ctrl-C ended with code {process.returncode}:\n{output[-2000:]}")
    if "--resume" not in output:
        wrong.append(f"Ctrl-C did not say how to go on:\n{output[-2000:]}")
    if took > PROMPT:
        wrong.append(f"Ctrl-C took {took:.1f} s")
    return wrong


def content(run: Path) -> dict[str, Any]:
    """What a finished run holds, without the seconds that were measured."""
    curve = list(csv.DictReader(io.StringIO((run / "curve.csv").read_text())))
    found: dict[str, Any] = {"curve.csv": [{k: v for k, v in row.items() if k != "seconds"} for row in curve]}
    for name in POLICY:
        head = json.loads((run / f"{name}.json").read_text())
        del head["trained"]["seconds"]
        found |= {f"{name}.json": head, f"{name}.safetensors": (run / f"{name}.safetensors").read_bytes()}
    with np.load(run / "checkpoint.npz", allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    head = json.loads(arrays.pop("head").tobytes())
    head["notes"] = {"best": head["notes"]["best"], "rows": len(head["notes"]["curve"])}
    found["checkpoint head"] = head
    for name, array in arrays.items():
        fields = [array] if array.dtype.names is None else [array[field] for field in array.dtype.names]
        # field by field: the bytes that pad a record hold nothing
        found[f"checkpoint {name}"] = [(str(array.dtype), f.shape, f.tobytes()) for f in fields]
    return found


def differences(one: Path, other: Path) -> list[str]:
    """What two finished runs do not have in common, and files that were left half written."""
    first, second = content(one), content(other)
    names = sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))
    return [f"{name} differs" for name in names] + [f"{p} was left behind" for p in other.glob(".*.part")]


def await_checkpoint(process: subprocess.Popen[str], run: Path) -> None:
    """Return once the run has written another checkpoint than it has now, or has ended."""
    path = run / "checkpoint.npz"
    before = path.stat().st_ino if path.exists() else None
    while process.poll() is None and not (path.exists() and path.stat().st_ino != before):
        time.sleep(0.005)


def disturb(settings: Interruptions, run: Path, starting: float, between: float) -> list[str]:
    """Stop and resume a training as often as asked, then let it end; what went wrong.

    By turns it is stopped at any moment of its start and its first checkpoints, and soon after it has got on by one.

    Args:
        settings: how often, and how.
        run: folder.
        starting: seconds before it learns.
        between: seconds between its checkpoints.
    """
    moments = random.Random(settings.seed)
    wrong: list[str] = []
    done = 0
    while done < settings.kills:
        by = SIGNALS[settings.signal][done % 2]
        process = start(resumption(settings, run))
        if by == signal.SIGINT or done % 2:  # Ctrl-C while Python itself still starts is Python's to answer
            await_checkpoint(process, run)
            wait = moments.uniform(0.0, between)
        else:
            wait = moments.uniform(0.3 * starting, starting + between)
        found: list[str] = []
        try:
            output, _ = process.communicate(timeout=wait)
            if process.returncode:
                return [*wrong, f"the run could not be resumed:\n{output[-2000:]}"]
        except subprocess.TimeoutExpired:
            found = stop(process, by)
        if (run / LAST).exists():  # also where the signal met a Python that was only taking its leave
            print("the run ended before it was stopped: once more from the start", flush=True)
            shutil.rmtree(run)
            continue
        wrong += found
        done += 1
        print(f"{by.name} {done:3d} at {reached(run)} decisions", flush=True)
    finish(resumption(settings, run))
    return wrong


def reached(run: Path) -> int:
    """Decisions of the newest row of the curve."""
    curve = run / "curve.csv"
    return int(curve.read_text().splitlines()[-1].split(",")[0]) if curve.exists() else 0


def main(settings: Interruptions) -> int:
    """Disturb, compare, and print; the exit code."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = settings.folder or Path(temporary)
        seconds = finish(training(settings, folder / "whole"))
        began = time.perf_counter()
        finish(resumption(settings, folder / "whole"))  # has nothing left to do: what starting alone takes
        starting = time.perf_counter() - began
        print(f"undisturbed: {seconds:.1f} s, {starting:.1f} s of them to start and end", flush=True)
        between = (seconds - starting) * settings.every / settings.steps
        wrong = disturb(settings, folder / "killed", starting, between)
        wrong += differences(folder / "whole", folder / "killed")
    for line in wrong:
        print(line)
    print("the same bit for bit" if not wrong else f"{len(wrong)} things wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    cli.run(main)
