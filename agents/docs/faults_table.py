"""Short table of the study of faults, from docs/results/faults.csv; the command makes that file from a new study.

python -m agents.benchmark.faults --policies rate_square multi_step --output results/faults.json
python -m agents.docs.faults_table results/faults.json
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from agents.docs.readme import RESULTS
from baselines.command import cli
from baselines.command.markdown import table
from satid_gym.files import check_writable, read_json, write_text

FILE = RESULTS / "faults.csv"
POLICY = "generalist"
CASES = {
    "none": "none",
    "gyro dropout, silent": "gyro repeats its reading for 20 s, not flagged",
    "gyro outliers": "gyro outliers, 0.5 % of the readings",
    "tachometer stuck": "one tachometer stuck for 60 s",
    "wheel failed": "one wheel fails",
    "as drawn": 'as scenario "faults" draws them',
}
"""Cases of the short table, and what they are called there."""
COLUMNS = (
    "satellite", "case", "policy", "filter", "final_error", "nees_after", "nees_worst", "recovery_s", "recovery_s_95",
    "outside", "terminated", "revision",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """Files of the conversion."""

    results: Annotated[Path, tyro.conf.Positional]
    """File that the study wrote."""
    output: Path = FILE
    """The .csv."""


def csv_text(results: Mapping[str, Any]) -> str:
    """Every row of a study, with its revision; an empty field is a figure that does not exist."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for record in results["records"]:
        row = {**record, "revision": results["revision"]}
        writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
    return text.getvalue()


def short_table() -> str:
    """Six cases of one policy on microsat: without the gate / with it."""
    with FILE.open(encoding="utf-8", newline="") as file:
        rows = [r for r in csv.DictReader(file) if (r["satellite"], r["policy"]) == ("microsat", POLICY)]
    head = ["fault", "final error, %", "NEES", "outside, %"]
    body = [[name, *_pair([r for r in rows if r["case"] == case])] for case, name in CASES.items()]
    revisions = ", ".join(sorted({r["revision"] for r in rows if r["case"] in CASES}))
    return f"{table(head, body)}\n\nPolicy `{POLICY}`, microsat, drift; revision {revisions}."


def _pair(rows: Sequence[Mapping[str, str]]) -> list[str]:
    ungated, gated = sorted(rows, key=lambda r: r["filter"] == "gated")
    return [
        f"{_number(ungated[key], factor)} / {_number(gated[key], factor)}"
        for key, factor in (("final_error", 100.0), ("nees_after", 1.0), ("outside", 100.0))
    ]


def _number(text: str, factor: float) -> str:
    """Two digits, and no exponent that a table need not have."""
    if not text:
        return "-"
    value = factor * float(text)
    return f"{value:.0e}".replace("e+0", "e") if value >= 1e4 else f"{float(f'{value:.2g}'):g}"


def main(options: Conversion) -> int:
    """Convert the file that the command line names; the exit code."""
    check_writable(options.output.parent)
    results = read_json(options.results, "run python -m agents.benchmark.faults", keys=("records", "revision"))
    write_text(options.output, csv_text(results))
    print(f"{options.output} written")
    return 0


if __name__ == "__main__":
    cli.run(main)
