"""Command: a video of two policies side by side; see `agents.viewer.record`."""

from agents.viewer.record import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
