"""Command: teach a network what model-predictive excitation would do; see `agents.training.imitation`."""

import sys

from agents.training.imitation import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
