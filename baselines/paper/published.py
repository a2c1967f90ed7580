"""Published results of the paper: its two tables of mean relative errors in %, of its LS and its EKF."""

from __future__ import annotations

import csv
from pathlib import Path

CellKey = tuple[str, str, str]  # profile, satellite, inertia mode

_FOLDER = Path(__file__).parent


def published() -> dict[CellKey, dict[str, float]]:
    """Errors {"ls": %, "ekf": %} by (profile, satellite, inertia mode): 24 static cells and 72 dynamic ones."""
    tables: dict[CellKey, dict[str, float]] = {}
    for name in ("table_static.csv", "table_dynamic.csv"):
        with open(_FOLDER / name, newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                cell = row["profile"], row["satellite"], row.get("inertia_mode", "static")
                tables[cell] = {"ls": float(row["ls_error_pct"]), "ekf": float(row["ekf_error_pct"])}
    return tables
