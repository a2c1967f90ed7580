"""Make the report page again from the files that `python -m agents.compare` wrote; nothing is flown."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from agents.benchmark.report.page import rebuild
from agents.benchmark.results import file_names
from baselines.command import cli
from baselines.command.options import ScenarioName
from satid_gym.config import unknown_name
from satid_gym.scenario_catalogue import SCENARIOS


@dataclass(frozen=True, kw_only=True)
class Report:
    """Files of the report."""

    results: Path = Path("results")
    """Folder with compare.json and report_data.json; the page is written next to them."""
    scenario: ScenarioName = "default"
    """Scenario of the comparison, yours or a shipped one."""
    control: Literal["torque", "rate"] = "torque"
    """What its actions are."""


def main(report: Report) -> int:
    """Make the page that the command line asks for; the exit code."""
    with cli.user_errors():
        file = report.results / file_names(report.scenario, report.control)["results"]
        if report.scenario not in SCENARIOS and not file.is_file():
            raise unknown_name("scenario", report.scenario, SCENARIOS)
        path = rebuild(report.results, report.scenario, report.control)
    print(f"{path} written")
    return 0
