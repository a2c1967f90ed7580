"""Cost of Ray from one worker to many, in CPU seconds: `python -m tests.qa.cluster_cost`.

A cluster of nodes of one core each, on this machine, flies the tasks of a comparison, as `python -m
agents.compare --ray` hands them out. CPU seconds of all processes are counted, not wall time: a machine with fewer
cores than nodes shows them as well. Flights must equal those of this process bit for bit; the exit code is 1 where
they do not. Needs Ray, and Linux's /proc.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.benchmark.cell import fly_timed
from baselines.command import cli, cluster
from baselines.command.markdown import table
from satid_gym.config import check_integer
from satid_gym.evaluation import Flight, benchmark_scenario, seeds
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies import make_baseline
from satid_gym.satellite import BENCHMARK_SATELLITES

TICK = os.sysconf("SC_CLK_TCK")  # of the times in /proc, a second
MANY = 1000  # workers of the cluster on paper


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What to run."""

    workers: tuple[int, ...] = (1, 2, 4, 8)
    """Nodes of one core, a cluster for each number."""
    episodes: int = 50
    """Of each of the 24 tasks: two policies in twelve cells."""
    empty: int = 400
    """Tasks that do nothing, for the cost of a task itself."""
    idle: float = 5.0
    """Seconds for which a cluster is watched that has nothing to do."""

    def check(self) -> None:
        """Refuse counts that are no counts."""
        for name in ("episodes", "empty"):
            check_integer(name, getattr(self, name))
        for count in self.workers:
            check_integer("workers", count)


def cpu_seconds() -> dict[str, float]:
    """CPU seconds so far of this process, and of all that it has started, with those of them that have ended."""
    processes = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            before, _, after = path.read_text().rpartition(")")
            fields = after.split()
            processes[int(before.split()[0])] = int(fields[1]), [int(ticks) / TICK for ticks in fields[11:15]]
    mine, started = os.getpid(), 0.0
    for process, (parent, (user, system, *ended)) in processes.items():
        while parent not in (mine, 0) and process != mine:
            parent = processes.get(parent, (0,))[0]
        if process == mine:
            started += sum(ended)
        elif parent == mine:
            started += user + system + sum(ended)
    return {"driver": time.process_time(), "others": started}


def spent(work: Callable[[], Any]) -> tuple[Any, dict[str, float], float]:
    """Result of some work, CPU seconds by `cpu_seconds`' names, and seconds of wall time."""
    begin, start = cpu_seconds(), time.perf_counter()
    result = work()
    wall = time.perf_counter() - start
    return result, {name: now - begin[name] for name, now in cpu_seconds().items()}, wall


@contextlib.contextmanager
def nodes(count: int) -> Iterator[None]:
    """A cluster of its own, with a head that computes nothing, to which this process is connected."""
    import ray
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    try:
        for _ in range(count):
            made.add_node(num_cpus=1)
        ray.init(made.address, log_to_driver=False, logging_level="ERROR")
        yield
    finally:
        ray.shutdown()
        made.shutdown()


def tasks(episodes: int) -> list[tuple[Any, dict[str, Any]]]:
    """Policies with the episodes they fly, on one thread."""
    own = {"seeds": seeds("validation", episodes), "scenario": benchmark_scenario(), "num_threads": 1}
    return [
        (make_baseline(name, satellite), {"satellite": satellite, "inertia": mode, **own})
        for satellite, mode, name in itertools.product(BENCHMARK_SATELLITES, INERTIA_MODES, ("zero", "rate_square"))
    ]


def first(folder: Path, count: int) -> None:
    """A worker's first task: a flight, for which it imports and loads what is compiled, and the wait for the others."""
    policy, episodes = tasks(1)[1]
    fly_timed(policy, **episodes)
    (folder / str(os.getpid())).touch()
    while len(list(folder.iterdir())) < count:
        time.sleep(0.2)


def fly_all(pool: Executor, episodes: int) -> list[Flight]:
    """Flights of all tasks."""
    futures = [pool.submit(fly_timed, policy, **own) for policy, own in tasks(episodes)]
    return [future.result()[0] for future in futures]


def fly_here(episodes: int) -> list[Flight]:
    """Flights of all tasks, one after another in a thread of this process."""
    with ThreadPoolExecutor(1) as pool:
        return fly_all(pool, episodes)


def measure(count: int, cost: Cost) -> dict[str, float]:
    """Figures of a cluster with this number of workers, compared with this process just before.

    Raises:
        RuntimeError: flights differ from those of this process.
    """
    flown, local, _ = spent(lambda: fly_here(cost.episodes))
    with nodes(count), cluster.executor("auto", keep=False) as pool, tempfile.TemporaryDirectory() as folder:
        started = lambda: [f.result() for f in [pool.submit(first, Path(folder), count) for _ in range(count)]]  # noqa: E731
        _, start, _ = spent(started)
        _, idle, seconds = spent(lambda: time.sleep(cost.idle))
        idle = {name: used / seconds for name, used in idle.items()}  # a second, which the others' figures are without
        _, empty, took = spent(lambda: [f.result() for f in [pool.submit(abs, i) for i in range(cost.empty)]])
        results, full, wall = spent(lambda: fly_all(pool, cost.episodes))
    if any(one.error.tobytes() != other.error.tobytes() for one, other in zip(results, flown, strict=True)):
        raise RuntimeError(f"flights on {count} workers differ from those of this process")
    empty, full = ({n: used[n] - idle[n] * t for n in idle} for used, t in ((empty, took), (full, wall)))
    return {
        "workers": count,
        "CPU, times the local one": sum(full.values()) / local["driver"],
        "start, CPU s a worker": sum(start.values()) / count,
        "idle, CPU ms a second and node": 1e3 * sum(idle.values()) / (count + 1),
        "an empty task, CPU ms": 1e3 * sum(empty.values()) / cost.empty,
        "of it the driver's": 1e3 * empty["driver"] / cost.empty,
        "the driver's, CPU ms a flight": 1e3 * full["driver"] / len(flown),
        "empty tasks a second": cost.empty / took,
    }


def size(flight: Flight, policy: Any, episodes: dict[str, Any]) -> int:
    """Bytes of a task's call and its result."""
    return len(pickle.dumps((fly_timed, (policy,), episodes))) + len(pickle.dumps((flight, 0.0)))


def main(cost: Cost) -> int:
    """Measure and print; the exit code."""
    fly_here(2)  # compiles what is not compiled yet
    flown, local, _ = spent(lambda: fly_here(cost.episodes))
    each = local["driver"] / len(flown)
    print(f"{len(flown)} tasks of {cost.episodes} episodes: {each:.2f} CPU s each in this process")
    moved = np.mean([size(flight, *task) for flight, task in zip(flown, tasks(cost.episodes), strict=True)])
    print(f"a task's call and result: {moved / 1e3:.0f} kB\n")
    rows = []
    for count in cost.workers:
        try:
            rows.append(measure(count, cost))
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
        print(", ".join(f"{name} {value:.3g}" for name, value in rows[-1].items()), flush=True)
    print("\n" + table(list(rows[0]), [[f"{value:.3g}" for value in row.values()] for row in rows], 0))
    driver = max(row["the driver's, CPU ms a flight"] for row in rows) / 1e3
    start = max(row["start, CPU s a worker"] for row in rows)
    flights, limit, minutes = 1 / driver, MANY * driver, 100 * start / 60
    print(
        f"\non paper, {MANY} workers: the driver serves {flights:.0f} flights a second, so none waits where they take"
    )
    print(f"{limit:.2g} s or more; {start:.2g} CPU s to start are 1 % of {minutes:.2g} minutes")
    return 0


if __name__ == "__main__":
    cli.run(main)
