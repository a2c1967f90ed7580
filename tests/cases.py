"""Cases of a table that one test goes through: a failure names its case."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def case(what: object) -> Iterator[None]:
    """Add the case to the message of whatever fails inside."""
    try:
        yield
    except BaseException as error:  # pytest's own failures are no Exceptions
        error.add_note(f"case: {what}")
        raise
