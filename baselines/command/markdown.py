"""Tables of Markdown, the one writer for all pages."""

from __future__ import annotations

from collections.abc import Sequence

Row = Sequence[str]


def table(head: Row, rows: Sequence[Row], text_columns: int | None = None) -> str:
    """A table with a head.

    Args:
        head: names of the columns.
        rows: cells, as many in each row as there are columns.
        text_columns: number of columns, from the left, that hold text; those after them hold numbers and are aligned
            to the right. None: all hold text.

    Raises:
        ValueError: a row has more or fewer cells than the head.
    """
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"a row of the table {list(head)} must have {len(head)} cells, got {list(row)}")
    text = len(head) if text_columns is None else text_columns
    rule = ["---" if i < text else "---:" for i in range(len(head))]
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, rule, *rows])
