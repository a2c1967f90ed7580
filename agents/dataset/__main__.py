"""Command: flights as Minari data sets; see `agents.dataset.collection`."""

from agents.dataset.collection import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
