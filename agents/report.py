"""Command: make the report page again; see `agents.benchmark.report.__main__`."""

from agents.benchmark.report.__main__ import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
