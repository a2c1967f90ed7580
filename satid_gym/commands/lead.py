"""Subcommands `satid compare` and `satid train`, which run the checkout's commands."""

from __future__ import annotations

import importlib.util
import runpy
import sys
from collections.abc import Sequence
from typing import Any

MODULES = {
    "compare": ("agents.compare", "every policy on every satellite and inertia mode"),
    "train": ("agents.train", "train a policy"),
}


def add(parts: Any) -> None:
    """Add the subcommands to the help; `run` is called with what follows them."""
    for name, (_, what) in MODULES.items():
        parts.add_parser(name, help=f"{what}; in a checkout", add_help=False)


def run(name: str, arguments: Sequence[str]) -> int:
    """Run the checkout's command with the arguments that follow.

    Raises:
        ValueError: there is no checkout here.
    """
    module, _ = MODULES[name]
    if "" not in sys.path:
        sys.path.insert(0, "")  # a console script does not look in the folder that it is started in
    if importlib.util.find_spec("agents") is None:
        raise ValueError(
            f"satid {name} runs {module}, which is part of the checkout and not of the library: start it in the "
            'checkout, with pip install ".[train]"'
        )
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
    return 0
