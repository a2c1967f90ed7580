"""Text of a command line: its help at the terminal's width, and the command as shown in pages and records."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Help whose paragraphs are filled to the terminal's width, but for those that hold commands, indented by two."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = argparse.HelpFormatter._fill_text
        parts = [part if "\n  " in part else fill(self, part, width, indent) for part in text.strip().split("\n\n")]
        return "\n\n".join(parts)


def as_typed(arguments: Sequence[str]) -> str:
    """The command, with the names alone of files that were given by a path from the root."""
    return shlex.join(["satid", *map(_without_folders, arguments)])


def _without_folders(word: str) -> str:
    option, sign, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + sign + (Path(value).name if Path(value).is_absolute() else value)
