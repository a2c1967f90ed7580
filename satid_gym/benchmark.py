"""`python -m satid_gym.benchmark`: speed of the library, printed and written as JSON.

Machines differ and are shared: quote ratios of figures from one run.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from satid_gym.core import kernels
from satid_gym.estimators import FilterpyMomentumEKF, MomentumEKF
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import prior_of
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.vector import SatInertiaIDVectorEnv

_REPEATS = 5


def _best_rate(work: Callable[[], int]) -> float:
    """Items a second of the fastest of several runs; `work` returns how many items it did."""
    rates = []
    for _ in range(_REPEATS):
        start = time.perf_counter()
        count = work()
        rates.append(count / (time.perf_counter() - start))
    return max(rates)


def vector_rate(
    num_envs: int,
    num_threads: int | None = None,
    estimator: str | None = None,
    satellite: str = "random",
    scenario: str = "default",
) -> float:
    """Filter steps a second of whole environment steps: noise, truth, filter, reward, observation, info."""
    env = SatInertiaIDVectorEnv(
        num_envs, satellite=satellite, scenario=scenario, estimator=estimator, num_threads=num_threads
    )
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (2, num_envs, 3)).astype(np.float32)
    actions[1] = -actions[0]
    decisions = max(20, 100_000 // num_envs)

    def work() -> int:
        for i in range(decisions):
            env.step(actions[i % 2])
        return decisions * num_envs * env.problem.scenario.samples

    work()
    rate = _best_rate(work)
    env.close()
    return rate


def single_rate() -> float:
    """Decisions a second of `gymnasium.make`, resets included."""
    env = gymnasium.make("SatInertiaID-v0")
    action = np.array([0.05, -0.05, 0.05], np.float32)

    def work() -> int:
        for i in range(6000):
            if i % 300 == 0:
                env.reset(seed=i)
            env.step(action if i % 20 < 10 else -action)
        return 6000

    return _best_rate(work)


def frame_rate() -> float:
    """Frames a second that `render()` draws at 480 x 480, through an episode."""
    env = gymnasium.make("SatInertiaID-v0", render_mode="rgb_array")
    action = np.array([0.05, -0.05, 0.05], np.float32)

    def work() -> int:
        env.reset(seed=0)
        for i in range(60):
            for _ in range(5):
                env.step(action if i % 4 < 2 else -action)
            env.render()
        return 60

    rate = _best_rate(work)
    env.close()
    return rate


def filter_rates() -> tuple[float, float]:
    """Filter steps a second on the same readings: compiled, and filterpy with the same model in Python."""
    satellite = SATELLITES["microsat"]
    prior = prior_of(satellite, SCENARIOS["default"])
    rng = np.random.default_rng(0)
    gyro = 5e-5 * rng.standard_normal((3001, 3)) + 0.02
    wheel_speed = 0.05 * rng.standard_normal((3001, 3)) + 50.0
    compiled, reference = MomentumEKF(), FilterpyMomentumEKF()
    compiled.reset(prior, gyro[0], wheel_speed[0])
    records = compiled.records, compiled.work  # the arrays behind it: the step alone, without checks
    mean, covariance = np.empty((3001, 9)), np.empty((3001, 9, 9))
    nis = np.empty(3001)

    def run_compiled() -> int:
        kernels.run_filter(*records, gyro, wheel_speed, 0.1, mean, covariance, nis)
        return 3000

    def run_reference() -> int:
        reference.reset(prior, gyro[0], wheel_speed[0])
        for i in range(1, 1001):
            reference.predict(wheel_speed[i], 0.1)
            reference.update(gyro[i], wheel_speed[i])
        return 1000

    run_compiled()
    return _best_rate(run_compiled), _best_rate(run_reference)


_FIRST_STEP = (
    "import satid_gym, gymnasium; env = gymnasium.make('SatInertiaID-v0'); "
    "env.reset(seed=0); env.step(env.action_space.sample())"
)


def first_steps() -> tuple[float, float]:
    """Seconds from the start of Python to the end of the first step: cold, and with the cache warm."""
    with tempfile.TemporaryDirectory() as cache:
        times = []
        for _ in range(2):
            start = time.perf_counter()
            subprocess.run(
                [sys.executable, "-c", _FIRST_STEP], check=True, env={**os.environ, "NUMBA_CACHE_DIR": cache}
            )
            times.append(time.perf_counter() - start)
    return times[0], times[1]


def memory_per_environment() -> float:
    """Bytes of the vector environment's arrays, for each environment."""
    fleet = SatInertiaIDVectorEnv(1024).fleet
    return sum(part.nbytes for part in (*fleet.rows, *fleet.final)) / len(fleet)


def measure() -> dict[str, Any]:
    """Every figure, by name."""
    compiled, reference = filter_rates()
    cold, warm = first_steps()
    figures = {
        "vector_1024_filter_steps_per_s": vector_rate(1024),
        "vector_1024_one_thread_filter_steps_per_s": vector_rate(1024, num_threads=1),
        "vector_64_filter_steps_per_s": vector_rate(64),
        "vector_1024_one_walk_filter_steps_per_s": vector_rate(1024, estimator="momentum"),
        **{
            f"vector_256_{name}_filter_steps_per_s": vector_rate(256, satellite="microsat", scenario=name)
            for name in ("default", "flex", "slosh", "calibration")
        },
        "single_decisions_per_s": single_rate(),
        "filter_compiled_steps_per_s": compiled,
        "filter_filterpy_steps_per_s": reference,
        "filter_compiled_over_filterpy": compiled / reference,
        "first_step_cold_s": cold,
        "first_step_warm_s": warm,
        "bytes_per_environment": memory_per_environment(),
    }
    if importlib.util.find_spec("pygame"):
        figures["rendered_frames_per_s"] = frame_rate()
    return figures


def main() -> None:
    """Print the figures and write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("results/benchmark.json"))
    output = parser.parse_args().output
    figures = measure()
    for name, value in figures.items():
        print(f"{name:45s} {value:14,.1f}")
    output.parent.mkdir(parents=True, exist_ok=True)
    machine = {"python": platform.python_version(), "cpus": os.cpu_count(), "machine": platform.machine()}
    output.write_text(json.dumps({"command": "python -m satid_gym.benchmark", "machine": machine, **figures}, indent=2))
    print(f"written to {output}")


if __name__ == "__main__":
    main()
