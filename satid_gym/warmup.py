"""Compilation of the core ahead of time, so that the first step of a run is fast: `python -m satid_gym.warmup`.

Each number of wheels, parameters, panels and tanks compiles code of its own, and so does a star tracker.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np

from satid_gym.problem import CONTROLS
from satid_gym.simulation import simulate
from satid_gym.vector import SatInertiaIDVectorEnv


def main(arguments: Sequence[str] | None = None) -> int:
    """Compile the kernels for a satellite in a scenario, or load them from the cache; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m satid_gym.warmup", description=__doc__)
    parser.add_argument("--satellite", default="microsat", help="name or file; default microsat")
    parser.add_argument("--scenario", default="default", help="name or file")
    parser.add_argument("--control", choices=CONTROLS, default="torque", help="what actions are; default torque")
    given = parser.parse_args(arguments)
    start = time.perf_counter()
    try:
        env = SatInertiaIDVectorEnv(1, given.satellite, "random", given.scenario, control=given.control)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    env.reset(seed=0)
    env.step(env.action_space.sample())
    satellite = env.problem.satellites[0]
    simulate(satellite, np.zeros((1, satellite.wheels.count)), 0.1)
    print(f"satid-gym: core ready after {time.perf_counter() - start:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
