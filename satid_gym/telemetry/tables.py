"""Tables of telemetry: columns of numbers, with the unit that header or cells give, from CSV and Parquet files."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from satid_gym.telemetry.units import split_header, unit_of

ENDINGS = (".csv", ".tsv", ".txt", ".parquet", ".pq")
_SHORT_MAX = 0.01  # of the rows may be cut off, as in a downlink
_CELL = re.compile(r"^([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D.*)?$")


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a file.

    Attributes:
        file: it is in.
        header: as written.
        name: header without its unit.
        unit: that header or cells give, or None.
        values: (N,) float; NaN where a cell holds no number. Dates are seconds since 1970.
    """

    file: Path
    header: str
    name: str
    unit: str | None
    values: np.ndarray


def read_table(path: Path) -> list[Column]:
    """Columns of a file.

    Raises:
        ValueError: the file is missing, empty, or no table; or Parquet is asked for and pyarrow is not there.
    """
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
    if path.suffix.lower() in (".parquet", ".pq"):
        return _parquet(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not text in UTF-8") from error
    lines = text.splitlines()
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    delimiter = max(",;\t", key=first.count)
    reader = csv.reader(lines, delimiter=delimiter)
    rows = [(reader.line_num, row) for row in reader if any(map(str.strip, row)) and not row[0].startswith("#")]
    if len(rows) < 3:
        raise ValueError(f"{path} holds no table: expected a line of column names and two rows or more")
    (_, head), *numbered = rows
    wrong = [(number, row) for number, row in numbered if len(row) != len(head)]
    long = [place for place in wrong if len(place[1]) > len(head)]
    if long or len(wrong) > max(1, _SHORT_MAX * len(numbered)):
        number, row = (long or wrong)[0]
        raise ValueError(f"{path}: line {number} has {len(row)} cells where the table's first line names {len(head)}")
    body = [row + [""] * (len(head) - len(row)) for _, row in numbered]  # cut off: cells without a number
    comma = delimiter == ";"
    return [_column(path, name, [row[i] for row in body], comma) for i, name in enumerate(head)]


def _column(path: Path, header: str, cells: list[str], comma: bool) -> Column:
    name, unit = split_header(header)
    parsed = [_cell(cell.strip(), comma) for cell in cells]
    units = {found for _, text in parsed if text and (found := unit_of(text))}
    if len(units) > 1:
        raise ValueError(f"{path}: column {header!r} mixes the units {sorted(units)}")
    return Column(path, header, name, units.pop() if units else unit, np.array([value for value, _ in parsed]))


def _cell(cell: str, comma: bool) -> tuple[float, str]:
    """Number and unit of a cell."""
    found = _CELL.match(cell.replace(",", ".") if comma else cell)
    if found and not re.match(r"^[-:/T]\d", found[2] or ""):
        return float(found[1]), (found[2] or "").strip()
    try:
        date = datetime.fromisoformat(cell)
    except ValueError:
        return np.nan, ""
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp(), "s"


def _parquet(path: Path) -> list[Column]:
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ImportError as error:
        raise ValueError(f'{path}: to read Parquet, pip install ".[telemetry]" in the checkout') from error
    try:
        table: Any = parquet.read_table(path)
    except arrow.ArrowInvalid as error:
        raise ValueError(f"{path} is not a Parquet file: {error}") from error
    found = []
    for header in table.column_names:
        column = table[header]
        if arrow.types.is_string(column.type) or arrow.types.is_large_string(column.type):
            found.append(_column(path, header, [str(cell or "") for cell in column.to_pylist()], comma=False))
            continue
        name, unit = split_header(header)
        if arrow.types.is_timestamp(column.type):
            values = column.cast(arrow.timestamp("ns")).to_numpy().astype("datetime64[ns]")
            seconds = values.astype(np.int64) / 1e9
            found.append(Column(path, header, name, "s", np.where(np.isnat(values), np.nan, seconds)))
        elif arrow.types.is_floating(column.type) or arrow.types.is_integer(column.type):
            found.append(Column(path, header, name, unit, column.to_numpy().astype(float)))
    return found
