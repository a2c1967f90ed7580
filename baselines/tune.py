"""Command: tune every baseline; see `baselines.tuning.amplitudes`."""

import sys

from baselines.command.cli import ended
from baselines.tuning.amplitudes import main

if __name__ == "__main__":
    sys.exit(ended(main))
