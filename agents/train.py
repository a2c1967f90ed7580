"""Command: train a policy; see `agents.training.train`."""

from agents.training.train import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
