"""Make the report page again from the files that `python -m agents.compare` wrote; nothing is flown."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from agents.benchmark.report.page import rebuild
from agents.benchmark.results import file_names
from baselines.command.cli import ended
from baselines.command.options import ScenarioName
from satid_gym.config import unknown_name
from satid_gym.scenario import SCENARIOS


@dataclass(frozen=True, kw_only=True)
class Report:
    """Of what to make a page."""

    results: Path = Path("results")
    """Folder with compare.json and report_data.json; the page is written next to them."""
    scenario: ScenarioName = "default"
    """Scenario of the comparison, yours or a shipped one."""


def main() -> int:
    """Make the page that the command line asks for; the exit code."""
    report = tyro.cli(Report, description=__doc__)
    try:
        file = report.results / file_names(report.scenario)["results"]
        if report.scenario not in SCENARIOS and not file.is_file():
            raise unknown_name("scenario", report.scenario, SCENARIOS)
        path = rebuild(report.results, report.scenario)
    except (FileNotFoundError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{path} written")
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
