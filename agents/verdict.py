"""Command: acceptance of the learned policies; see `agents.benchmark.acceptance`."""

import sys

from agents.benchmark.acceptance import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
