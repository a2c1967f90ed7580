"""Executor of a cluster's tasks without a cluster: results that are lost on their way, and what is of the sources."""

from __future__ import annotations

import pickle
from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from baselines.command import cluster


@pytest.fixture
def pool(tmp_path):
    """An executor, and the future of the worker that runs its next task."""
    done: Future[bytes] = Future()
    made = object.__new__(cluster.RayExecutor)
    made._ray = SimpleNamespace(cloudpickle=pickle)
    made._task = SimpleNamespace(remote=lambda *_: SimpleNamespace(future=lambda: done))
    made._folder, made._files = tmp_path / "tasks", []
    return made, done


def test_a_result_is_kept_until_it_is_forgotten(pool):
    executor, done = pool
    future = executor.submit(max, 1, 2)
    done.set_result(pickle.dumps(2))
    assert future.result(timeout=5) == 2
    assert executor.submit(max, 1, 2).result(timeout=5) == 2
    executor.forget()
    assert list(executor._folder.iterdir()) == []


@pytest.mark.parametrize(
    ("sent", "folder", "error"),
    [(b"no pickle", None, pickle.UnpicklingError), (pickle.dumps(2), "in the way", FileExistsError)],
)
def test_a_result_that_cannot_be_read_or_kept_is_an_error(pool, tmp_path, sent, folder, error):
    """The command would else wait for it without end."""
    executor, done = pool
    executor._folder = tmp_path / folder if folder else None
    if folder:
        executor._folder.write_text("a file")
    future = executor.submit(max, 1, 2)
    done.set_result(sent)
    with pytest.raises(error):
        future.result(timeout=5)


@pytest.mark.parametrize(
    ("file", "counts"),
    [
        ("satid_gym/a.py", True),
        ("satid_gym/policies/tuned.json", True),
        ("satid_gym/policies/learned/pretrained/a.safetensors", True),
        ("agents/a.py", True),
        ("baselines/scenarios/tuned.json", False),
        ("satid_gym/__pycache__/a.pyc", False),
    ],
)
def test_machines_have_the_same_sources_settings_and_weights(file, counts, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "_ROOT", tmp_path)
    before = cluster.sources.__wrapped__()
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text("changed")
    assert (cluster.sources.__wrapped__() != before) == counts
