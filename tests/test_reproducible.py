"""The same command gives the same result: on another run, in another process, with another number of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.golden.flights import CASES, fly
from tests.qa.long_haul import SAMPLES, Haul, LongHaul

pytestmark = pytest.mark.slow  # in processes of its own

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
    costs = infos.pop("costs").values()
    for array in (observations, rewards, *ends, *infos.values(), *costs):
        digest.update(np.ascontiguousarray(array).tobytes())
for record in env.state().values():  # the attitude shows only here
    for name in record.dtype.names or ():
        digest.update(record[name].tobytes())
print(json.dumps({"threads": len(env.fleet._spans), "digest": digest.hexdigest()}))
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


def run(*command: str, threads: int, **environment: str) -> str:
    """What a fresh process prints, with numba held to a number of threads."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=ROOT,
        env={**os.environ, "NUMBA_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_vector_rollout_is_the_same_bit_by_bit_with_any_number_of_threads():
    found = [json.loads(run("-c", ROLLOUT, str(threads), threads=threads)) for threads in THREADS]
    assert [f["threads"] for f in found] == [1, 2, 3]  # so that it was in fact shared out
    assert len({f["digest"] for f in found}) == 1


def test_a_process_that_compiles_the_core_rounds_as_one_that_loads_it(tmp_path):
    """Functions that are called, and not inlined, are linked from elsewhere when a kernel comes from the cache."""
    found = [run("-c", ROLLOUT, "2", threads=2, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert any(tmp_path.rglob("*.nbc"))  # so that the second had something to load
    assert found[0] == found[1]


def test_evaluation_is_the_same_bit_by_bit_with_any_number_of_threads():
    found = [json.loads(run("-c", FLY, str(threads), threads=threads)) for threads in (1, 3)]
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


def test_golden_flights_are_written_again_in_another_process(tmp_path):
    run("-m", "tests.golden", "--output", str(tmp_path / "flights.json"), threads=2)
    written = json.loads((tmp_path / "flights.json").read_text())["flights"]
    assert written == {case: fly(case) for case in CASES}


def test_a_long_haul_is_the_same_with_any_number_of_threads(tmp_path):
    found = []
    for threads in (1, 2):
        run = Haul(LongHaul(decisions=64 * SAMPLES, envs=64, threads=threads, output=tmp_path / "haul.json"))
        run.run()
        run.env.close()
        found.append({name: value for name, value in run.seen.items() if name != "samples"})
    assert found[0] == found[1]
