"""Ray: tasks on a cluster give the bits of a local run, also where a machine is lost, and go on after a stop."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import sys
import threading
import time

import numpy as np
import pytest

ray = pytest.importorskip("ray")

from ray.cluster_utils import Cluster

from agents.benchmark import compare
from agents.training import train
from baselines.command import cluster
from baselines.command.cli import exit_code
from baselines.scenarios import oracle
from baselines.scenarios.flights import Cell
from satid_gym.evaluation import seeds
from tests.cases import cases

ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import a test
pytestmark = pytest.mark.reach
TIMES = {"decision_ms"}  # what a comparison says of its machine
COMPARE = "--satellites microsat --modes static step --policies zero rate_square --episodes 3 --seed-split validation"


@pytest.fixture(scope="module")
def machines():
    """A cluster of three machines with a core each, the first of which does not compute."""
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [made.add_node(num_cpus=1) for _ in range(3)]
    ray.init(made.address, log_to_driver=False, logging_level="ERROR")
    yield made, nodes
    ray.shutdown()
    made.shutdown()


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def command(monkeypatch, main, line):
    monkeypatch.setattr(sys, "argv", ["command", *line.split()])
    assert exit_code(main) == 0


def test_no_cluster():
    with pytest.raises(cluster.UserError, match=r"no Ray cluster at '127.0.0.1:1' .*or give --ray local"):
        list(cluster.each(np.add, [(1, 2)], "127.0.0.1:1"))


def test_a_comparison_on_a_cluster_equals_the_local_one(machines, monkeypatch, tmp_path, capsys):
    local, spread = tmp_path / "local", tmp_path / "spread"
    command(monkeypatch, compare.main, f"{COMPARE} --output {local}")
    command(monkeypatch, compare.main, f"{COMPARE} --output {spread} --ray auto")
    own, others = (list(csv.DictReader((folder / "compare.csv").open())) for folder in (local, spread))
    assert len(own) == 2 * 2
    assert [{k: v for k, v in row.items() if k not in TIMES} for row in own] == [
        {k: v for k, v in row.items() if k not in TIMES} for row in others
    ]
    tables = [json.loads((folder / "compare.json").read_text()) for folder in (local, spread)]
    assert tables[0]["pairs"] == tables[1]["pairs"]
    own, others = ({k: v for k, v in table["settings"].items() if k != "output"} for table in tables)
    assert own == others, "where it ran is no setting"


def test_an_oracle_on_a_cluster_finds_the_same(machines):
    cell, episodes = Cell(scenario="flex", satellite="microsat", inertia="static"), seeds("validation", 2)
    here, there = (oracle.search(cell, episodes, 0.01, population=2, rounds=1, ray=ray) for ray in (None, "auto"))
    for field in dataclasses.fields(oracle.Flown):
        np.testing.assert_array_equal(getattr(here, field.name), getattr(there, field.name), field.name)


@cases("address", [None, "auto"])
def test_each_gives_results_in_order(machines, address):
    assert list(cluster.each(np.add, [(i, 2 * i) for i in range(5)], address)) == [0, 3, 6, 9, 12]


def test_runs_on_a_cluster_equal_those_trained_here(machines, monkeypatch, tmp_path):
    settings = "--name tiny --seeds 0 1 --steps 400 --num-envs 4 --rollout 50 --batch-size 200 --evaluation-episodes 2"
    policies = []
    for folder, more in (("here", ""), ("there", " --ray auto")):
        (tmp_path / folder).mkdir()
        monkeypatch.chdir(tmp_path / folder)
        command(monkeypatch, train.main, f"{settings} --satellite microsat{more}")
        policies.append([(tmp_path / folder / f"runs/tiny-{seed}/last.safetensors").read_bytes() for seed in (0, 1)])
    assert policies[0] == policies[1]
    assert policies[0][0] != policies[0][1]


def _hangs_on(doomed, folder, number):
    """A task that says in a folder that it has begun, and on one machine never ends; on others it waits for that."""
    (folder / f"{number}-{os.getpid()}").touch()
    if ray.get_runtime_context().get_node_id() == doomed:
        (folder / "hangs").touch()
        time.sleep(600.0)
    while not (folder / "hangs").exists():
        time.sleep(0.02)
    return number * np.arange(3.0)


def test_a_machine_that_is_lost_costs_its_tasks_alone(machines, tmp_path):
    made, nodes = machines
    lost = nodes.pop()

    def lose():
        while not (tmp_path / "hangs").exists():
            time.sleep(0.02)
        made.remove_node(lost, allow_graceful=False)

    thief = threading.Thread(target=lose)
    thief.start()
    found = list(cluster.each(_hangs_on, [(lost.node_id, tmp_path, i) for i in range(9)], "auto"))
    thief.join()
    np.testing.assert_array_equal(found, np.outer(np.arange(9), np.arange(3.0)))
    began = sorted(path.name.partition("-")[0] for path in tmp_path.glob("*-*"))
    assert len(began) == 9 + 1, f"the lost machine's task began twice, the others' once: {began}"


def _stops(folder, number):
    """A task that counts how often it has run, and fails in the middle until the folder says otherwise."""
    with (folder / str(number)).open("a") as file:
        file.write("x")
    if number == 2 and not (folder / "mended").exists():
        raise ArithmeticError("in mid-command")
    return number


def test_a_command_goes_on_with_what_it_has(machines, tmp_path):
    calls = [(tmp_path, i) for i in range(4)]
    with pytest.raises(ArithmeticError, match="in mid-command"):
        list(cluster.each(_stops, calls, "auto"))
    while len(list(cluster.cache().iterdir())) < 2:  # results that had come
        time.sleep(0.02)
    (tmp_path / "mended").touch()
    assert list(cluster.each(_stops, calls, "auto")) == [0, 1, 2, 3]
    assert (tmp_path / "0").read_text() == (tmp_path / "1").read_text() == "x"
    assert (tmp_path / "2").read_text() == "xx"
    assert not list(cluster.cache().iterdir()), "nothing is kept of a command that has ended"


def test_other_sources_are_refused(machines, monkeypatch):
    monkeypatch.setattr(cluster, "sources", lambda: "other")
    with pytest.raises(RuntimeError, match=r"has other sources in .*: install the same revision on every machine"):
        list(cluster.each(np.add, [(1, 2)], "auto"))
