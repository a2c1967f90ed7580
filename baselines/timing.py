"""Command: compute time of a policy's decisions; see `baselines.studies.timing`."""

from baselines.command import cli
from baselines.studies.timing import main

if __name__ == "__main__":
    cli.run(main)
