"""The same command gives the same result: on another run, in another process, with another number of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
THREADS = (1, 2, 3)

ROLLOUT = """
import hashlib, json, sys
import numpy as np
from satid_gym import SatInertiaIDVectorEnv

env = SatInertiaIDVectorEnv(60, satellite="random", num_threads=int(sys.argv[1]), max_episode_steps=15)
chance = np.random.default_rng(0)
digest = hashlib.sha256(env.reset(seed=5)[0].tobytes())
for _ in range(40):
    observations, rewards, *ends, infos = env.step(chance.uniform(-0.5, 0.5, (60, 3)))
    for array in (observations, rewards, *ends, *infos.values()):
        digest.update(np.ascontiguousarray(array).tobytes())
print(json.dumps({"threads": len(env._shares), "digest": digest.hexdigest()}))
"""

FLY = """
import hashlib, json, sys
from baselines import make_baseline
from satid_gym.evaluation import fly, seeds

digest = hashlib.sha256()
for name in ("rate_square", "random"):
    flight = fly(
        make_baseline(name, "cubesat"), satellite="cubesat", inertia="random", seeds=seeds("test", 50),
        scenario={"horizon": 60.0}, num_threads=int(sys.argv[1]),
    )
    for series in (flight.error, flight.nees, flight.information, flight.reward, flight.outside):
        digest.update(series.tobytes())
print(json.dumps({"digest": digest.hexdigest()}))
"""


def run(*command: str, threads: int) -> str:
    """What a fresh process prints, with numba held to a number of threads."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=ROOT,
        env={**os.environ, "NUMBA_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_vector_rollout_is_the_same_bit_by_bit_with_any_number_of_threads():
    found = [json.loads(run("-c", ROLLOUT, str(threads), threads=threads)) for threads in (*THREADS, 1)]
    assert [f["threads"] for f in found] == [1, 2, 3, 1]  # so that it was in fact shared out
    assert len({f["digest"] for f in found}) == 1


def test_evaluation_is_the_same_bit_by_bit_with_any_number_of_threads():
    found = [json.loads(run("-c", FLY, str(threads), threads=threads)) for threads in THREADS]
    assert len({f["digest"] for f in found}) == 1


def without_timings(results: dict[str, Any]) -> dict[str, Any]:
    """compare.json without what a clock or the command line put there."""
    kept = {name: value for name, value in results.items() if name not in ("command", "settings", "revision")}
    kept["efficiencies"] = [{k: v for k, v in row.items() if k != "decision_ms"} for row in results["efficiencies"]]
    return kept


def test_the_comparison_writes_the_same_numbers_again(tmp_path):
    found = []
    for threads in (1, 3):
        folder = tmp_path / str(threads)
        run(
            *("-m", "agents.compare", "--episodes", "3", "--satellites", "cubesat", "--modes", "static"),
            *("--policies", "rate_square", "zero", "generalist", "--output", str(folder)),
            threads=threads,
        )
        found.append(without_timings(json.loads((folder / "compare.json").read_text())))
    assert found[0]["records"]
    assert found[0] == found[1]


@pytest.mark.parametrize("module", ["tests.golden", "tests.long_haul"])
def test_commands_beside_the_tests_write_the_same_again(module, tmp_path):
    extra = ["--decisions", "12800", "--envs", "64"] if module == "tests.long_haul" else []
    found = []
    for threads in (1, 2):
        output = tmp_path / f"{threads}.json"
        limit = ["--threads", str(threads)] if module == "tests.long_haul" else []
        run("-m", module, "--output", str(output), *extra, *limit, threads=threads)
        results = json.loads(output.read_text())
        clockwork = ("command", "revision", "samples", "decisions_per_s", "last_tenth_over_first")
        memory = ("resident_mb", "bytes_per_million_decisions")
        found.append({name: value for name, value in results.items() if name not in (*clockwork, *memory)})
    assert found[0] == found[1]
