"""Command: a video of two policies side by side; see `agents.viewer.record`."""

import sys

from agents.viewer.record import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
