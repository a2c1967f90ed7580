"""Command: one episode of two policies, live; see `agents.viewer.watch`."""

import sys

from agents.viewer.watch import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
