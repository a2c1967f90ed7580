"""The paper's two result tables: mean relative error in %, of its LS and its EKF."""

from __future__ import annotations

import csv
from pathlib import Path

Cell = tuple[str, str, str]  # profile, satellite, inertia mode

_FOLDER = Path(__file__).parent


def published() -> dict[Cell, dict[str, float]]:
    """{"ls": %, "ekf": %} by (profile, satellite, inertia mode): 24 static cells and 72 dynamic ones."""
    tables: dict[Cell, dict[str, float]] = {}
    for name in ("table_static.csv", "table_dynamic.csv"):
        with open(_FOLDER / name, newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                cell = row["profile"], row["satellite"], row.get("inertia_mode", "static")
                tables[cell] = {"ls": float(row["ls_error_pct"]), "ekf": float(row["ekf_error_pct"])}
    return tables
