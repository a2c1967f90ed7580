"""Interruptions: what is killed, full, locked or damaged costs time and a line of text, never a result."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time

import pytest

from agents.docs import readme
from agents.training import train
from baselines.command.cli import exit_code
from satid_gym.files import DamagedFileError, check_writable, read_json, write_bytes
from tests.cases import cases
from tests.qa.interruption import (
    PROMPT,
    ROOT,
    Interruptions,
    await_checkpoint,
    differences,
    finish,
    heed_interrupts,
    resumption,
    start,
    stop,
    training,
)

pytestmark = pytest.mark.slow  # trains in processes of its own and stops them

SHORT = Interruptions(steps=24_000, every=3_200)


@pytest.fixture
def refused(monkeypatch, capsys):
    """The one line that a training with given arguments ends with at once."""

    def line(arguments):
        monkeypatch.setattr(sys, "argv", ["train", *arguments])
        assert exit_code(train.main) == 2
        errors = capsys.readouterr().err
        assert errors.count("\n") == 1
        return errors

    return line


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A short training that ended by itself."""
    folder = tmp_path_factory.mktemp("interruption") / "whole"
    finish(training(SHORT, folder))
    return folder


def test_a_run_that_is_killed_and_interrupted_ends_as_if_nothing_had_happened(whole, tmp_path):
    run = tmp_path / "run"
    for by in (signal.SIGKILL, signal.SIGINT):
        process = start(resumption(SHORT, run))
        await_checkpoint(process, run)
        assert stop(process, by) == []
    finish(resumption(SHORT, run))
    assert differences(whole, run) == []


def test_ctrl_c_stops_a_run_whose_parent_ignores_it():
    """As a shell's background jobs do."""
    code = """
import sys, time
try:
    print("ready", flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    print("go on with --resume")
    sys.exit(130)
"""
    heeded = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        process = start(["-c", code])
    finally:
        signal.signal(signal.SIGINT, heeded)
    assert process.stdout.readline() == "ready\n"
    assert stop(process, signal.SIGINT) == []


def full_after(count):
    """What a child calls so that no file of its may grow beyond `count` bytes: to it the disk is full."""

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (count, count))

    return limit


def test_a_full_disk_ends_a_run_with_a_line_and_it_goes_on_when_there_is_room(whole, tmp_path):
    run = tmp_path / "run"
    command = [sys.executable, *training(SHORT, run)]
    done = subprocess.run(command, cwd=ROOT, preexec_fn=full_after(60_000), capture_output=True, text=True)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "too large" in done.stderr.splitlines()[-1]  # what a limit is called; a disk says that no space is left
    finish(resumption(SHORT, run))
    assert differences(whole, run) == []


@pytest.mark.parametrize("folder", ["/dev/null/run", "/proc/run", "file/run", "file"])
def test_folders_that_cannot_be_written_are_one_line(tmp_path, folder, refused):
    (tmp_path / "file").write_text("in the way")
    run = tmp_path / folder
    assert str(run).removesuffix("/run") in refused(training(SHORT, run)[2:])


@cases(
    ("settings", "message"),
    [
        ("", "is not JSON"),
        ('{"settings": {"steps"', "is not JSON"),
        ('{"settings": {"steps": "many"}}', "holds no settings"),
        ('{"settings": [1]}', "must be a mapping of names to values, got [1]"),
        ("[1]", "holds no settings"),
        ('{"settings": {"steps": 100}}', "is of another version, without ['batch_size'"),
        ("[" * 100_000, "is not JSON"),
    ],
)
def test_damaged_settings_of_a_run_are_one_line(tmp_path, settings, message, refused):
    (tmp_path / "run.json").write_text(settings)
    assert message in refused(["--run", str(tmp_path), "--resume"])


def test_an_unwritable_output_is_known_before_the_work(tmp_path):
    (tmp_path / "file").write_text("in the way")
    line = [sys.executable, "-m", "agents.compare", "--output", str(tmp_path / "file")]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr == f"error: {tmp_path / 'file'}: File exists\n"
    with pytest.raises(OSError, match="Not a directory"):
        check_writable(tmp_path / "file" / "below")


def test_a_full_disk_leaves_the_old_file(tmp_path):
    path = tmp_path / "results.json"
    write_bytes(path, b"old")
    code = f"""
from pathlib import Path
from baselines.command.cli import exit_code
from satid_gym.files import write_bytes
raise SystemExit(exit_code(lambda: write_bytes(Path({str(path)!r}), b"new" * 1000)))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, preexec_fn=full_after(1000), capture_output=True, text=True
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_comparison_leaves_the_old_files(tmp_path):
    old = tmp_path / "compare.json"
    old.write_text("old")
    process = subprocess.Popen(
        [sys.executable, "-m", "agents.compare", "--policies", "mpc", "zero", "--output", str(tmp_path)],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1,
        preexec_fn=heed_interrupts,
    )  # fmt: skip
    shown = ""
    while "comparing" not in shown:
        shown += process.stderr.read(1)
        assert process.poll() is None, shown
    process.send_signal(signal.SIGINT)
    began = time.perf_counter()
    _, errors = process.communicate()
    assert process.returncode == 130
    assert time.perf_counter() - began < PROMPT
    assert "Traceback" not in errors
    assert errors.splitlines()[-1] == "stopped; existing files are unchanged"
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"compare.json": "old"}


@cases("text", ["", '{"records": [', "[]", '{"records": []}', "\x00" * 100])
def test_damaged_results_are_one_line(tmp_path, text, monkeypatch):
    (tmp_path / "compare.json").write_text(text)
    monkeypatch.setattr(readme, "RESULTS", tmp_path)
    with pytest.raises(DamagedFileError, match=r"compare\.json.*restore it") as error:
        readme.written("")
    assert "\n" not in str(error.value)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_an_error_of_the_system(tmp_path):
    path = tmp_path / "locked.json"
    path.write_text(json.dumps({}))
    path.chmod(0)
    with pytest.raises(PermissionError):
        read_json(path, "unlock it")


def test_the_comparison_refuses_to_see_a_run_as_the_same_when_it_is_not(whole, tmp_path):
    other = shutil.copytree(whole, tmp_path / "other")
    tensors = (other / "policy.safetensors").read_bytes()
    (other / "policy.safetensors").write_bytes(tensors[:-1] + bytes([tensors[-1] ^ 1]))
    (other / ".curve.csv.x.part").write_text("half")
    found = differences(whole, other)
    assert found == ["policy.safetensors differs", f"{other / '.curve.csv.x.part'} was left behind"]
