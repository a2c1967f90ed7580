"""Command: write the README's tables; see `agents.docs.readme`."""

from agents.docs.readme import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
