"""Command: compute time of a policy's decisions; see `baselines.studies.timing`."""

import sys

from baselines.command.cli import ended
from baselines.studies.timing import main

if __name__ == "__main__":
    sys.exit(ended(main))
