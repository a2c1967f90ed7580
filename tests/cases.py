"""Tables of cases that one test goes through; a failure names its case."""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Callable, Iterable, Iterator
from typing import Any


@contextlib.contextmanager
def case(what: object) -> Iterator[None]:
    """Add the case to the message of whatever fails inside."""
    try:
        yield
    except BaseException as error:  # pytest's own failures are no Exceptions
        error.add_note(f"case: {what}")
        raise


def cases(names: str | tuple[str, ...], values: Iterable[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Table of a test, written as for `pytest.mark.parametrize`, whose cases are one thing and count as one test.

    Fixtures are the same for all cases, but for `tmp_path`: each has a folder of its own.
    """
    names, rows = (names,) if isinstance(names, str) else names, list(values)

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def go_through(**fixtures: Any) -> None:
            for number, row in enumerate(rows):
                given = dict(zip(names, (row,) if len(names) == 1 else row, strict=True))
                own = {}
                if "tmp_path" in fixtures:
                    own["tmp_path"] = fixtures["tmp_path"] / f"case_{number}"
                    own["tmp_path"].mkdir()
                with case(given):
                    test(**{**fixtures, **own, **given})

        signature = inspect.signature(test)
        left = [parameter for name, parameter in signature.parameters.items() if name not in names]
        go_through.__signature__ = signature.replace(parameters=left)  # type: ignore[attr-defined]
        return go_through

    return decorate
