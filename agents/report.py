"""Command: make the report page again; see `agents.benchmark.report.__main__`."""

import sys

from agents.benchmark.report.__main__ import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
