"""Build of wheel and sdist, twice, and use of the wheel alone: `python -m tests.qa.distribution`.

Writes dist/. The second build is made in another folder from the first one's sdist, and must give the same bytes. The
wheel is then installed in a virtual environment of its own, which sees what this one has of others' packages, but not
this checkout; with --index pip installs those there, as for a user. README's first examples run there. `make dist`
calls it. The exit code is 1 where something fails.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

from baselines.command import cli

ROOT = Path(__file__).parents[2]
FLY = """
import importlib.util, sys
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policies import find, make_baseline
world = benchmark_scenario().replace(horizon=30.0)
for policy in (find("generalist"), make_baseline("mpc", "microsat")):
    flight = fly(policy, satellite="microsat", inertia="static", seeds=seeds("validation", 2), scenario=world)
    assert flight.error[-1].max() < 0.02, flight.error[-1]
    print(f"{policy.name}: relative error {flight.error[-1].max():.4f} after {flight.time[-1]:.0f} s")
assert not {"torch", "stable_baselines3"} & set(sys.modules)
assert not any(map(importlib.util.find_spec, ("agents", "baselines")))
"""


@dataclass(frozen=True, kw_only=True)
class Distribution:
    """What to build."""

    index: bool = False
    """Let pip install what the wheel needs from its index, in place of what is installed here."""


def first_examples() -> str:
    """README's first two blocks of Python: the environment, and one episode."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    return "\n".join(blocks[:2])


def call(*command: str | Path, cwd: Path = ROOT) -> str:
    """Output of a command.

    Raises:
        RuntimeError: it failed; the message is what it printed.
    """
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # it may name this checkout
    done = subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True, env=own)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout.strip()


def build(source: Path, output: Path) -> tuple[Path, Path]:
    """Build wheel and sdist with what is installed; their paths."""
    call(sys.executable, "-m", "build", "--no-isolation", "--sdist", "--wheel", "--outdir", output, cwd=source)
    (wheel,), (sdist,) = output.glob("*.whl"), output.glob("*.tar.gz")
    return wheel, sdist


def unpack(sdist: Path, folder: Path) -> Path:
    """The folder that a sdist unpacks to."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    (inner,) = folder.iterdir()
    return inner


def contents(wheel: Path) -> list[str]:
    """Names of the files in a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


def install(wheel: Path, folder: Path, *, index: bool = False) -> Path:
    """A virtual environment with the wheel, and others' packages by path or from the index; its Python."""
    venv.create(folder, with_pip=False)
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    if index:
        call(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", wheel)
        return python
    call(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel)
    places = call(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder)
    # a path in a .pth file is searched, but .pth files there are not read: an editable install stays out of sight
    (Path(places) / "others.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    return python


def main(distribution: Distribution) -> int:
    """Build, compare, install and use; the exit code."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        try:
            first = build(ROOT, folder / "first")
            second = build(unpack(first[1], folder / "elsewhere"), folder / "second")
            for one, other in zip(first, second, strict=True):
                same = one.read_bytes() == other.read_bytes()
                print(f"{one.name}: {one.stat().st_size / 1e3:.0f} kB, {'the same' if same else 'OTHER'} bytes twice")
                if not same:
                    return 1
            print(call(sys.executable, "-m", "twine", "check", "--strict", *first))
            python = install(first[0], folder / "environment", index=distribution.index)
            print(call(sys.executable, "-m", "pip", "--python", python, "check"))
            print(call(python, "-m", "satid_gym.warmup", cwd=folder))
            print(call(python, "-c", first_examples(), cwd=folder))
            print(call(python, "-c", FLY, cwd=folder))
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
        (ROOT / "dist").mkdir(exist_ok=True)
        for path in first:
            path.replace(ROOT / "dist" / path.name)
    print("written to dist/")
    return 0


if __name__ == "__main__":
    cli.run(main)
