"""Command: the standing table; see `agents.standing.table`."""

import agents.benchmark.blas  # noqa: F401  before numpy
from agents.standing.table import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
