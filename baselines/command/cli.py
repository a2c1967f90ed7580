"""Command runner: settings from the command line, and one line on standard error instead of a traceback."""

from __future__ import annotations

import inspect
import os
import signal
import sys
import typing
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

import tyro

from baselines.command.provenance import checkout
from satid_gym.files import DamagedFileError

INTERRUPTED = 128 + signal.SIGINT  # what a shell reports
UNCHANGED = "existing files are unchanged"

Main = Callable[..., int | None]


class UserError(Exception):
    """What the user asked for cannot be done; the text says why and what to do."""


@contextmanager
def user_errors() -> Iterator[None]:
    """Mistakes of the user: a ValueError within ends the command with one line, anywhere else it is a bug.

    Raises:
        UserError: for a ValueError within, with its text.
    """
    try:
        yield
    except ValueError as error:
        raise UserError(str(error)) from error


@contextmanager
def on_interrupt(text: str) -> Iterator[None]:
    """Text after "stopped;" if Ctrl-C comes within: what is left and how to go on. Also decorates a function."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(text) from None


def run(main: Main) -> NoReturn:
    """Run a command and end the process with its `exit_code`."""
    sys.exit(exit_code(main))


def exit_code(main: Main) -> int:
    """Exit code of a command.

    Args:
        main: the command; returns the exit code, None is 0. The type of its first parameter is the dataclass of its
            settings, see `settings_of`; its module's docstring is the help.

    Returns:
        130 after Ctrl-C; 2 for mistakes of the user (see `user_errors`), damaged files, and files or folders that
        cannot be read or written.
    """
    checkout()  # before the work: a commit meanwhile is not of the code that runs
    try:
        with user_errors():
            settings = settings_of(main, sys.argv[1:])
        return main(*settings) or 0
    except KeyboardInterrupt as interrupt:
        print(f"\nstopped; {str(interrupt) or UNCHANGED}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # whoever read the output, such as head, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except (DamagedFileError, UserError) as error:
        print(f"error: {error}", file=sys.stderr)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}", file=sys.stderr)
    return 2


def settings_of(main: Main, arguments: Sequence[str]) -> list[Any]:
    """Settings of a command from its arguments, checked: a list of one, or of none for a command without settings.

    A settings class may have `parse(arguments)`, where a plain `tyro.cli` is not enough, and a method `check`.

    Raises:
        ValueError: `parse` or `check` refuses them, or there are some and the command takes none.
        SystemExit: tyro does, or the help was asked for.
    """
    parameters = list(inspect.signature(main).parameters)
    if not parameters:
        if arguments:
            raise ValueError(f"this command has no options, got {' '.join(arguments)}")
        return []
    kind = typing.get_type_hints(main)[parameters[0]]
    if hasattr(kind, "parse"):
        return [kind.parse(arguments)]
    settings = tyro.cli(kind, prog=program(), args=arguments, description=sys.modules[main.__module__].__doc__)
    if hasattr(settings, "check"):
        settings.check()
    return [settings]


def program() -> str | None:
    """The command as it was called, `python -m MODULE`, for its help; None where it was not called so."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return None if spec is None else f"python -m {spec.name.removesuffix('.__main__')}"
