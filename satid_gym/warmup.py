"""Compilation of the core ahead of time, so that the first step of a run is fast: `python -m satid_gym.warmup`."""

from __future__ import annotations

import time

import numpy as np

from satid_gym.satellite import SATELLITES
from satid_gym.simulation import simulate
from satid_gym.vector import SatInertiaIDVectorEnv


def main() -> None:
    """Compile the kernels for three wheels and principal moments, or load them from the cache."""
    start = time.perf_counter()
    env = SatInertiaIDVectorEnv(1)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    simulate(SATELLITES["microsat"], np.zeros((1, 3)), 0.1)
    print(f"satid-gym: core ready after {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
