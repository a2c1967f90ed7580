"""Command: find the score of corners by evolution; see `agents.evolution.corners`."""

from agents.evolution.corners import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
