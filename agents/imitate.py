"""Command: teach a network what model-predictive excitation would do; see `agents.training.imitation`."""

from agents.training.imitation import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
