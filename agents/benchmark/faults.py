"""Fault study with the shipped policies in addition to the baselines: `python -m agents.benchmark.faults`."""

from __future__ import annotations

import sys

from baselines.command.cli import ended
from baselines.studies import faults
from satid_gym.policies.shipped import shipped

if __name__ == "__main__":
    sys.exit(ended(lambda: faults.main(shipped(), "agents.benchmark.faults")))
