"""How a command ends: what is refused, Ctrl-C and bad files are one line on standard error, never a traceback."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from satid_gym.files import DamagedFileError

INTERRUPTED = 128 + signal.SIGINT  # what a shell reports


class RefusedError(Exception):
    """What a command was asked for cannot be done; its text is for the user."""


def ended(main: Callable[[], int | None], resume: str = "what was there before is untouched") -> int:
    """Run a command; its exit code.

    Args:
        main: the command; what it returns is the exit code, None is 0.
        resume: what to say after Ctrl-C: what is left, and how to go on.

    Returns:
        130 after Ctrl-C; 2 where a file or folder cannot be read or written, or is damaged, or `refusal` was met.
    """
    try:
        return main() or 0
    except KeyboardInterrupt:
        print(f"\nstopped; {resume}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # whoever read the output, such as head, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except (DamagedFileError, RefusedError) as error:
        print(f"error: {error}", file=sys.stderr)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}; nothing of the old is lost", file=sys.stderr)
    return 2


@contextmanager
def refusal() -> Iterator[None]:
    """End the command where what it was asked for is refused: goes around whatever checks that.

    Raises:
        RefusedError: for a ValueError within, with its text.
    """
    try:
        yield
    except ValueError as error:
        raise RefusedError(str(error)) from error
