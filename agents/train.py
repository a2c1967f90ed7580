"""Command: train a policy with PPO; see `agents.training.ppo`."""

import sys

from agents.training.ppo import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
