"""How a command ends: Ctrl-C and files that cannot be used are one line on standard error, never a traceback."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable

from baselines.provenance import DamagedFileError

INTERRUPTED = 128 + signal.SIGINT  # what a shell reports


def ended(main: Callable[[], int | None], resume: str = "what was there before is untouched") -> int:
    """Run a command; its exit code.

    Args:
        main: the command; what it returns is the exit code, None is 0.
        resume: what to say after Ctrl-C: what is left, and how to go on.

    Returns:
        130 after Ctrl-C; 2 where a file or folder cannot be read or written, or is damaged.
    """
    try:
        return main() or 0
    except KeyboardInterrupt:
        print(f"\nstopped; {resume}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # whoever read the output, such as head, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except DamagedFileError as error:
        print(f"error: {error}", file=sys.stderr)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}; nothing of the old is lost", file=sys.stderr)
    return 2
