"""Command: the benchmark; see `agents.benchmark.compare`."""

import agents.benchmark.blas  # noqa: F401  before numpy
from agents.benchmark.compare import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
