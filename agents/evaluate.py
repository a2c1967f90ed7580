"""Command: score one policy; see `agents.benchmark.evaluate`."""

import agents.benchmark.blas  # noqa: F401  before numpy
from agents.benchmark.evaluate import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
