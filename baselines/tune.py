"""Command: tune every baseline; see `baselines.tuning.amplitudes`."""

from baselines.command import cli
from baselines.tuning.amplitudes import main

if __name__ == "__main__":
    cli.run(main)
