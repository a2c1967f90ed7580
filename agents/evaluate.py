"""Command: score one learned policy; see `agents.benchmark.evaluate`."""

import sys

import agents.benchmark.blas  # noqa: F401  before numpy
from agents.benchmark.evaluate import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
