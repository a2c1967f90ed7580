"""Command: write the README's tables; see `agents.docs.readme`."""

import sys

from agents.docs.readme import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
