"""Tries mutants: reads requests, one line of JSON each, and answers in kind; `python -m tests.qa.mutation` starts it.

The libraries are imported once. Every trial is a fork that imports the mutated module in the place of the file's
and runs the tests as plain Python until the first fails. Files are never changed, so a trial can be ended at any
moment, and none sees another's.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import importlib.machinery
import importlib.util
import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import pytest

from tests.qa.mutation.mutants import mutate

_LIBRARIES = (
    "numba",
    "scipy.stats",
    "scipy.integrate",
    "scipy.spatial.transform",
    "gymnasium",
    "hypothesis",
    "filterpy",
)


class _MutantLoader(importlib.machinery.SourceFileLoader):
    """Loads code that is given in the place of the file's."""

    def __init__(self, name: str, path: str, code: CodeType) -> None:
        super().__init__(name, path)
        self.code = code

    def get_code(self, fullname: str) -> CodeType:
        return self.code


class _MutantFinder:
    """Finds the mutated module before the import system finds the file's."""

    def __init__(self, name: str, path: Path, tree: ast.Module) -> None:
        self.name, self.path, self.code = name, str(path), compile(tree, str(path), "exec", dont_inherit=True)
        self.asked = False

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if name != self.name:
            return None
        self.asked = True
        return importlib.util.spec_from_loader(name, _MutantLoader(name, self.path, self.code))


class _Watch:
    """Runs the tests in a given order; keeps how long each took and which failed."""

    def __init__(self, order: Sequence[str]) -> None:
        self.rank = {test: i for i, test in enumerate(order)}
        self.seconds: dict[str, float] = {}
        self.killer: str | None = None

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: self.rank.get(item.nodeid, len(self.rank)))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped:
            return
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed and self.killer is None:
            self.killer = report.nodeid


def _run(request: dict[str, Any]) -> dict[str, Any]:
    """In the fork: import the mutant and run the tests."""
    seconds = request["seconds"]
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    finder = None
    if request["index"] is not None:
        path = Path(request["path"])
        tree = mutate(path.read_text(encoding="utf-8"), request["index"])
        finder = _MutantFinder(".".join(path.with_suffix("").parts), path, tree)
        sys.meta_path.insert(0, finder)  # type: ignore[arg-type]
    watch = _Watch(request["order"])
    options = ["-x", "-q", "--tb=no", "--assert=plain", "-p", "no:cacheprovider"]
    began = time.process_time()
    code = pytest.main([*options, *request["tests"]], plugins=[watch])
    if finder is not None and not finder.asked:
        raise RuntimeError(f"the tests do not import {finder.name}, or it was imported before the trial")
    outcome = "survived" if code == pytest.ExitCode.OK else "killed"
    if code == pytest.ExitCode.NO_TESTS_COLLECTED:
        outcome = "untested"
    killer = watch.killer or "import"  # a mutant that cannot even be imported fails in collection
    return {
        "outcome": outcome,
        "killer": killer if outcome == "killed" else None,
        "seconds": time.process_time() - began,
        "tests": watch.seconds if request["index"] is None else {},
    }


def _try(request: dict[str, Any]) -> dict[str, Any]:
    """Fork, run, and wait; a trial that takes too much time counts as killed."""
    sys.stdout.flush()
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        null = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(null, stream)
        with os.fdopen(write, "w") as answer:
            try:
                result = _run(request)
            except BaseException:  # of this driver: pytest catches those of the tests
                result = {"outcome": "failed", "message": traceback.format_exc()}
            json.dump(result, answer)
            answer.flush()
            os._exit(0)
    os.close(write)
    with os.fdopen(read) as answer:
        # processor time is limited in the fork; this is for what sleeps
        if not select.select([answer], [], [], 20.0 * request["seconds"])[0]:
            os.kill(child, signal.SIGKILL)
        text = answer.read()
    _, status = os.waitpid(child, 0)
    if text:
        return json.loads(text)
    if os.WIFSIGNALED(status):
        return {"outcome": "killed", "killer": "timeout", "seconds": float(request["seconds"]), "tests": {}}
    return {"outcome": "killed", "killer": "crash", "seconds": 0.0, "tests": {}}


def main() -> None:
    """Serve until the input ends."""
    for library in _LIBRARIES:
        importlib.import_module(library)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
        pytest.main(["--noconftest", "--version", "--version"])  # imports what every trial needs of pytest
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever sends the requests decides when to stop
    with contextlib.suppress(BrokenPipeError):  # nobody waits for the answer any more
        for line in sys.stdin:
            print(json.dumps(_try(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
