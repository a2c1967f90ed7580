"""Command: flights as Minari data sets; see `agents.datasets.dataset`."""

from agents.datasets.dataset import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
