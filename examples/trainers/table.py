"""Table of docs/trainers.md: every trainer of this folder, one after the other.

PYTHONPATH=. python examples/trainers/table.py --seeds 0 1 2
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
from excitation import Learned, command

FILES = sorted(Path(__file__).parent.glob("ppo_*.py"))

if __name__ == "__main__":
    print("| trainer | decisions | final error of each seed, % | outside, % | s a seed | revision |")
    print("| --- | ---: | --- | --- | ---: | --- |", flush=True)
    command(lambda steps, seed: Learned(lambda observations: np.zeros((len(observations), 3))), "none: rates of zero")
    for file in FILES:
        words = [sys.executable, str(file), *sys.argv[1:]]
        said = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout  # noqa: S603  # own files
        print(*(line for line in said.splitlines() if line.startswith("| ")), sep="\n", flush=True)
