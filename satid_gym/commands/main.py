"""Command `satid`: subcommands, exit codes, and one line on standard error instead of a traceback.

Exit codes: 0 done; 1 the data do not tell or contradict the satellite, its data sheet is doubtful, or what is asked
cannot be; 2 arguments or files; 130 Ctrl-C.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence

from satid_gym import __version__
from satid_gym.commands import check, design, export, fly, identify, lead
from satid_gym.identification import NotIdentifiedError, SlipError
from satid_gym.manoeuvres import NotPossibleError

NO, WRONG, STOPPED = 1, 2, 128 + signal.SIGINT


def parser() -> argparse.ArgumentParser:
    """Parser of the command line."""
    top = argparse.ArgumentParser(
        prog="satid",
        description="Satellites that identify their own inertia: from a data sheet and recorded flights.",
        epilog=f"exit codes: 0 done, {NO} the data do not identify or contradict the satellite, or the request "
        f"is infeasible, {WRONG} arguments or files, {STOPPED} Ctrl-C",
    )
    top.add_argument("--version", action="version", version=f"satid-gym {__version__}")
    parts = top.add_subparsers(metavar="COMMAND", required=True)
    for module in (check, design, fly, identify, export):
        module.add(parts)
    lead.add(parts)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    try:
        words = list(sys.argv[1:] if arguments is None else arguments)
        if words and words[0] in lead.MODULES:  # their options are the checkout's own
            return lead.run(words[0], words[1:])
        given = parser().parse_args(words)
        given.words = words
        return int(given.run(given))
    except KeyboardInterrupt:
        print("\nstopped; existing files are unchanged", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:  # whoever read the output, such as head, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except (NotIdentifiedError, NotPossibleError, SlipError) as error:
        print(f"no: {error}", file=sys.stderr)
        return NO
    except (ValueError, FloatingPointError) as error:
        print(f"error: {error}", file=sys.stderr)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}; existing files are unchanged", file=sys.stderr)
    return WRONG


if __name__ == "__main__":
    sys.exit(main())
