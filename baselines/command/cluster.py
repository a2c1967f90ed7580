"""Executor of a command's tasks: threads of this machine, or the machines of a Ray cluster with `--ray`.

A task is a function of a module with its arguments and depends on nothing else, so that its result is the same
wherever it runs. On a cluster a task whose worker is lost runs again elsewhere, and results of the others are kept: on
the disk, in the user's cache folder, until the command has ended, so that the same command goes on after a stop.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
import socket
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm

from baselines.command.cli import UserError
from satid_gym.files import write_bytes

RayAddress = Annotated[str | None, tyro.conf.arg(name="ray", metavar="ADDRESS")]
"""Where to run tasks: None for threads of this process, else as `ray.init` takes it."""

RETRIES = 5  # of a task whose worker is lost
_ROOT = Path(__file__).parents[2]
_SOURCES = {  # by package; baselines.scenarios.tune writes a .json while its tasks run
    "satid_gym": (".py", ".json", ".safetensors"),
    "baselines": (".py",),
    "agents": (".py",),
}


@contextmanager
def executor(address: str | None, *, keep: bool = True) -> Iterator[Executor]:
    """Executor for the tasks of a command; if it is stopped, it ends without waiting for tasks that have not begun.

    Args:
        address: "auto" for the cluster that this machine is part of, HOST:PORT or ray://HOST:PORT for another, "local"
            for a new one of this machine alone; None: threads of this process, as many as there are cores.
        keep: whether results of tasks on a cluster are kept on the disk until the end.

    Raises:
        UserError: Ray is not installed, or there is no cluster at the address.
    """
    pool = ThreadPoolExecutor(os.cpu_count()) if address is None else RayExecutor(address, keep=keep)
    try:
        yield pool
    except BaseException:
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()
    if isinstance(pool, RayExecutor):
        pool.forget()


def each(
    task: Callable[..., Any], calls: Sequence[tuple[Any, ...]], address: str | None, *, keep: bool = True, **bar: Any
) -> Iterator[Any]:
    """Results of a task in the order of its calls, for tasks that take all cores of a machine by themselves.

    Args:
        task: function of a module.
        calls: arguments of each.
        address: of a cluster, on which they run side by side; None: one after another in this process.
        keep: see `executor`.
        **bar: of the progress bar.
    """
    with tqdm(total=len(calls), **bar) as progress, ExitStack() as stack:
        if address is None:
            results = (task(*call) for call in calls)
        else:
            pool = stack.enter_context(executor(address, keep=keep))
            results = (future.result() for future in [pool.submit(task, *call) for call in calls])
        for result in results:
            progress.update()
            yield result


class RayExecutor(Executor):
    """Tasks on a Ray cluster, one for each core of its machines.

    Every machine has the same revision of this checkout and its packages; a task refuses to run on other sources.

    Args:
        address: of the cluster; see `executor`. Where this process is connected already, it stays connected.
        keep: whether results are kept on the disk; see `forget`.

    Raises:
        UserError: Ray is not installed, or there is no cluster at the address.
    """

    def __init__(self, address: str, *, keep: bool) -> None:
        try:
            import ray
        except ModuleNotFoundError as error:
            raise UserError(
                '--ray needs Ray, which is not installed: pip install "ray>=2.60" on every machine'
            ) from error
        self._owner = not ray.is_initialized()
        if self._owner:
            try:
                _check_reachable(address)
                ray.init(address=address, log_to_driver=False, logging_level="ERROR")
            except (OSError, ValueError) as error:
                line = " ".join(str(error).split())
                raise UserError(
                    f"no Ray cluster at {address!r} ({line}): start one by `ray start --head`, or give --ray local"
                ) from error
        one_thread = {"env_vars": {"OMP_NUM_THREADS": "1"}}  # a core has one task
        self._ray = ray
        self._task = ray.remote(num_cpus=1, max_retries=RETRIES, runtime_env=one_thread)(_run)
        self._folder = cache() if keep else None
        self._files: list[Path] = []

    def submit(self, task: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """Run a task on the cluster, unless its result is kept."""
        call = self._ray.cloudpickle.dumps((task, arguments, named))
        future: Future[Any] = Future()
        file = self._folder / hashlib.sha256(sources().encode() + call).hexdigest() if self._folder else None
        if file is not None:
            self._files.append(file)
            if file.is_file():
                future.set_result(pickle.loads(file.read_bytes()))
                return future

        def finish(done: Future[bytes]) -> None:
            try:
                if file is not None:
                    write_bytes(file, done.result())
                future.set_result(pickle.loads(done.result()))
            except BaseException as error:  # of the task, a full disk, a result that cannot be read: `result` raises it
                future.set_exception(error)

        future.set_running_or_notify_cancel()
        self._task.remote(call, sources()).future().add_done_callback(finish)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster, which ends this process's tasks; nothing where it was connected before."""
        if self._owner:
            self._ray.shutdown()

    def forget(self) -> None:
        """Remove the results that were kept."""
        for file in self._files:
            file.unlink(missing_ok=True)


def _check_reachable(address: str) -> None:
    """Refuse an address where nobody listens, for which Ray would wait many minutes.

    Raises:
        OSError: nobody does.
    """
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host, int(port)), timeout=10.0).close()


def cache() -> Path:
    """Folder for the results of tasks, in the user's cache; what is in it is unpickled, as numba does with its own."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "satid_gym" / "tasks"


@functools.cache
def sources() -> str:
    """Digest of the sources that this process runs, by which machines tell whether they have the same.

    Settings and weights that the environment's package holds are part of it: tasks fly with them.
    """
    digest = hashlib.sha256()
    for package, endings in _SOURCES.items():
        for path in sorted((_ROOT / package).rglob("*")):
            if path.suffix in endings:
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _run(call: bytes, digest: str) -> bytes:
    """A task on a worker. Arguments and result are bytes: arrays that Ray shares among processes cannot be written."""
    import ray

    if digest != sources():
        raise RuntimeError(
            f"{os.uname().nodename} has other sources in {_ROOT} than the machine that asks: install the same revision "
            "on every machine"
        )
    task, arguments, named = pickle.loads(call)
    return ray.cloudpickle.dumps(task(*arguments, **named))
