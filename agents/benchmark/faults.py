"""Fault study with the shipped policies in addition to the baselines: `python -m agents.benchmark.faults`."""

from __future__ import annotations

from baselines.command import cli
from baselines.studies import faults
from baselines.studies.faults import FaultStudy
from satid_gym.policies.learned.shipped import shipped


def main(settings: FaultStudy) -> int:
    """Run the study; the exit code."""
    return faults.main(settings, shipped(), "agents.benchmark.faults")


if __name__ == "__main__":
    cli.run(main)
