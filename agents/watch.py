"""Command: one episode of two policies, live; see `agents.viewer.watch`."""

from agents.viewer.watch import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
