"""Measures of flight code on this machine: sizes, operations and times."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from satid_gym.files import write_text
from satid_gym.flightcode.writer import texts
from satid_gym.onboard.pilot import Pilot

_FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2")


def compiler() -> str:
    """The C compiler: what the environment calls CC, or cc.

    Raises:
        ValueError: no C compiler is installed.
    """
    name = os.environ.get("CC", "cc")
    if shutil.which(name) is None:
        raise ValueError(f"no C compiler {name!r} here: install one (apt-get install gcc libc6-dev) or set CC")
    return name


def compiled(folder: Path, *more: str) -> Path:
    """Program that replays test vectors, `check`, of the C in a folder.

    Args:
        folder: of `satid_gym.flightcode.write`.
        more: arguments for the compiler.

    Raises:
        ValueError: there is no compiler, or it refuses the code.
    """
    sources = [str(path) for path in sorted(folder.glob("*.c"))]
    run = _run([compiler(), *_FLAGS, *more, "-o", str(folder / "check"), *sources, "-lm"])
    if run.returncode != 0:
        raise ValueError(f"the compiler refuses the code: {run.stderr.strip()}")
    return folder / "check"


def measures(output: Path, pilot: Pilot) -> list[str]:
    """Lines with sizes of code, constants and state, operations and time of a reading, of what was written there.

    Raises:
        ValueError: there is no compiler, or the code does not do what the test vectors say.
    """
    with tempfile.TemporaryDirectory() as name:
        plain, counting = Path(name) / "plain", Path(name) / "counting"
        for folder, counts in ((plain, False), (counting, True)):
            for file, text in texts(pilot, counts).items():
                write_text(folder / file, text)
        replay = _replayed(compiled(plain), output)
        counted = _replayed(compiled(counting, "-DSATID_COUNTING"), output)
        sizes = [_sections(path) for path in sorted(plain.glob("*.c")) if path.name != "check.c"]
    code, constants, data = (sum(size[i] for size in sizes) for i in range(3))
    rows = np.loadtxt(output / "vectors.csv", delimiter=",", skiprows=1)
    return [
        f"{code} bytes of code, {constants} of constants, {data} of static data ({compiler()} {' '.join(_FLAGS)})",
        *replay,
        counted[-1],
        f"{1e6 * _seconds(pilot, rows) / len(rows):.1f} us a reading by Pilot in Python",
    ]


def _run(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False)


def _replayed(check: Path, output: Path) -> list[str]:
    run = _run([str(check), str(output / "vectors.csv")])
    if run.returncode != 0:
        raise ValueError(f"the code does not fly the test vectors: {(run.stdout + run.stderr).strip()}")
    return run.stdout.splitlines()


def _sections(source: Path) -> tuple[int, int, int]:
    """Bytes of code, constants and data of one source's object."""
    target = source.with_suffix(".o")
    _run([compiler(), *_FLAGS, "-c", "-o", str(target), str(source)])
    found = {"text": 0, "rodata": 0, "data": 0, "bss": 0}
    for line in _run(["size", "-A", str(target)]).stdout.splitlines():
        section, *numbers = line.split() or [""]
        name = section.lstrip(".").partition(".")[0]
        if section.startswith(".") and name in found:
            found[name] += int(numbers[0])
    return found["text"], found["rodata"], found["data"] + found["bss"]


def _seconds(pilot: Pilot, rows: np.ndarray) -> float:
    """Time that the pilot takes for the readings."""
    n, tracked = pilot.problem.wheels, pilot.mission.prior.sensors.star_tracker is not None
    readings = [(row[0], row[1:4], row[4 : 4 + n], row[4 + n : 8 + n] if tracked else None) for row in rows]
    pilot.start(*readings[0])
    begun = time.perf_counter()
    for reading in readings[1:]:
        pilot.step(*reading)
    return time.perf_counter() - begun
