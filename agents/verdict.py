"""Command: acceptance of the learned policies; see `agents.benchmark.acceptance`."""

from agents.benchmark.acceptance import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
