"""Command: the benchmark; see `agents.benchmark.compare`."""

import sys

import agents.benchmark.blas  # noqa: F401  before numpy
from agents.benchmark.compare import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
