"""Command: train a policy with PPO; see `agents.training.ppo`."""

from agents.training.ppo import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
