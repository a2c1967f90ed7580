"""Provenance of a result: command, revision and versions."""

from __future__ import annotations

import dataclasses
import functools
import importlib.metadata
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[2]
_PACKAGES = ("satid-gym", "gymnasium", "numpy", "scipy", "numba", "stable-baselines3", "torch")


def result_head(
    module: str,
    settings: Any = None,
    *,
    split: str | None = None,
    seeds: Sequence[int] = (),
    packages: Iterable[str] = _PACKAGES,
    output: Path | None = None,
) -> dict[str, Any]:
    """Head of a file of results: command, revision, versions and, where given, settings and seeds.

    Args:
        module: of the command.
        settings: plain values, or a dataclass of them; of absolute paths the last name is kept.
        split: that the seeds are of.
        seeds: consecutive seeds that were flown.
        packages: whose versions matter.
        output: the file, where a command that was stopped goes on with it: that it differs does not count.
    """
    head: dict[str, Any] = {"command": command(module), "revision": revision(output), "versions": versions(packages)}
    if settings is not None:
        values: Mapping[str, Any] = settings if isinstance(settings, Mapping) else dataclasses.asdict(settings)
        head["settings"] = {k: portable(str(v)) if isinstance(v, Path) else v for k, v in values.items()}
    if split is not None:
        head["seeds"] = {"split": split, "first": seeds[0], "count": len(seeds)}
    return head


def command(module: str, arguments: Iterable[str] | None = None) -> str:
    """The command line of this process, or of a module's arguments, as a user would type it.

    Of absolute paths it has the last name alone.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    return shlex.join(["python", "-m", module, *map(portable, arguments)])


def portable(argument: str) -> str:
    """An argument without the folders of an absolute path."""
    option, sign, value = argument.rpartition("=")
    return f"{option}{sign}{Path(value).name}" if Path(value).is_absolute() else argument


def revision(output: Path | None = None) -> str:
    """Git revision of the checkout, with "-dirty" where files but an `output` differ; "unknown" outside of one."""
    found, changed = checkout()
    own = set() if output is None else {output.resolve()}
    return f"{found}-dirty" if changed - own else found


@functools.cache
def checkout() -> tuple[str, frozenset[Path]]:
    """Git revision, and the files that differ from it, when this was first asked for: of the code that was imported."""
    try:
        found = _git("describe", "--always", "--abbrev=12", "--exclude=*").strip()
        changed = _git("diff", "--name-only", "--no-relative", "-z", "HEAD").split("\0")
        top = Path(_git("rev-parse", "--show-toplevel").rstrip("\n"))
    except (OSError, subprocess.CalledProcessError):
        return "unknown", frozenset()
    return found, frozenset((top / name).resolve() for name in changed if name)


def _git(*arguments: str) -> str:
    command = ["git", *arguments]
    return subprocess.run(command, cwd=_ROOT, capture_output=True, text=True, check=True).stdout


def versions(packages: Iterable[str] = _PACKAGES) -> dict[str, str]:
    """Versions of Python and of those `packages` that are installed."""
    installed = {"python": platform.python_version()}
    for package in packages:
        try:
            installed[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return installed
