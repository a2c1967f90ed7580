"""Where a result comes from: command, revision and versions."""

from __future__ import annotations

import importlib.metadata
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

_PACKAGES = ("satid-gym", "gymnasium", "numpy", "scipy", "numba", "stable-baselines3", "torch")


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


def revision() -> str:
    """Git revision of the checkout, with "-dirty" where files differ from it; "unknown" outside of one."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()


def versions(packages: Iterable[str] = _PACKAGES) -> dict[str, str]:
    """Versions of Python and of those `packages` that are installed."""
    installed = {"python": platform.python_version()}
    for package in packages:
        try:
            installed[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return installed
