"""Command: make the report page again; see `agents.benchmark.report.command`."""

from agents.benchmark.report.command import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
