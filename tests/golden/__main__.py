"""Write the golden flights again: `python -m tests.golden`.

Only for a change of behaviour that is meant, and then with a new version of the environment's id.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.files import check_writable, write_text
from tests.golden.flights import CASES, DATA, fly


@dataclass(frozen=True, kw_only=True)
class Golden:
    """Where to write."""

    output: Path = DATA
    """JSON file with which the tests compare the environment."""
    new: bool = False
    """Fly only the cases that it lacks, and keep the others as they are."""


def main(settings: Golden) -> int:
    """Fly every case and write what it gave; the exit code."""
    check_writable(settings.output.parent)
    kept = json.loads(settings.output.read_text(encoding="utf-8"))["flights"] if settings.new else {}
    flown = tqdm(CASES, desc="golden flights", unit="flight")
    flights = {case: kept[case] if case in kept else fly(case) for case in flown}
    head = result_head("tests.golden")
    lines = ",\n".join(
        f" {json.dumps(case)}: {json.dumps(flight, allow_nan=False)}" for case, flight in flights.items()
    )
    text = json.dumps({**head, "flights": {}}, indent=1).replace('"flights": {}', f'"flights": {{\n{lines}\n }}')
    write_text(settings.output, text + "\n")  # a flight a line: numbers need no lines of their own
    print(f"{len(flights)} flights written to {settings.output}")
    return 0


if __name__ == "__main__":
    cli.run(main)
