"""The compiler's cache where it is damaged, full or nowhere to be kept, and what the user is told.

Kernels of a line are compiled in processes of their own. The tests may run as root, whom no permission stops. What
cannot be written is therefore made so by the kind of file: a file stands where a folder would have to be, which the
system refuses to everybody. A full disk is a limit on the size of files: beyond it write() ends in OSError too.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import satid_gym

pytestmark = [pytest.mark.compiled, pytest.mark.slow]
COMPILING = "satid-gym: compiling its core for this kind of satellite, about 50 s, once; python -m satid_gym.warmup"
TINY = """
from satid_gym.core.jit import kernel

@kernel
def twice(x):
    return 2.0 * x

@kernel
def thrice(x):
    return 3.0 * x
"""
CALL = "import tiny; assert (tiny.twice(3.0), tiny.thrice(3.0)) == (6.0, 9.0)"


@pytest.fixture
def folder(tmp_path):
    """Where a module with two kernels of a line lies."""
    (tmp_path / "tiny.py").write_text(TINY)
    return tmp_path


def call(folder, code=CALL, package=Path(satid_gym.__file__).parents[1], **changes):
    """Standard error, by lines, of Python code that must succeed; the cache is `folder`/cache unless changed."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    environment |= {"PYTHONPATH": os.pathsep.join([str(package), str(folder)]), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"NUMBA_CACHE_DIR": str(folder / "cache")} | changes
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stderr.splitlines()


def test_the_first_compilation_is_announced_once_and_none_from_the_cache(folder):
    assert [line.startswith(COMPILING) for line in call(folder)] == [True]
    assert call(folder) == []


def test_a_kernel_is_of_its_source_whatever_the_time_of_the_file(folder):
    """So that a cache can be taken along to another checkout; an edit is seen though size and time are the same."""
    file = folder / "tiny.py"
    call(folder)
    os.utime(file, (1e9, 1e9))
    assert call(folder) == []
    file.write_text(TINY.replace("3.0", "4.0"))
    os.utime(file, (1e9, 1e9))
    assert [line.startswith(COMPILING) for line in call(folder, CALL.replace("9.0", "12.0"))] == [True]


def test_it_is_announced_before_it_starts(folder):
    code = "import sys, tiny; from numba.core import event\n"
    code += "class Told(event.Listener):\n"
    code += "    def on_start(self, e): print('compiling starts', file=sys.stderr)\n"
    code += "    def on_end(self, e): pass\n"
    code += "with event.install_listener('numba:compile', Told()): tiny.twice(3.0)"
    lines = call(folder, code)
    assert lines[0].startswith(COMPILING)
    assert lines[1] == "compiling starts"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The same with both kernels in the cache."""
    path = tmp_path_factory.mktemp("compiled")
    (path / "tiny.py").write_text(TINY)
    call(path)
    return path


@pytest.mark.parametrize("kept", [0.0, 0.6], ids=str)
@pytest.mark.parametrize("ending", ["nbc", "nbi"])
def test_a_damaged_entry_is_compiled_again_and_replaced(ending, kept, compiled):
    folder = compiled
    (path,) = (folder / "cache").rglob(f"*twice*.{ending}")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    lines = call(folder)
    assert len(lines) == 2
    assert "is damaged" in lines[0]
    assert "twice" in lines[0]
    assert lines[1].startswith(COMPILING)
    assert call(folder) == []


@pytest.mark.skipif(os.name != "posix", reason="sets a limit that POSIX has")
def test_a_full_disk_costs_time_and_is_said_once(folder):
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (512, 512))\n" + CALL
    lines = call(folder, full)
    assert len(lines) == 2
    assert lines[0].startswith(COMPILING)
    assert "what it compiled cannot be kept in" in lines[1]
    assert "set NUMBA_CACHE_DIR" in lines[1]
    assert not [path for path in (folder / "cache").rglob("*") if path.is_file()]  # no half of one either
    assert len(call(folder)) == 1
    assert call(folder) == []


def test_an_install_without_a_writable_cache_is_imported_and_compiles(folder):
    package = folder / "install"
    source, left_out = Path(satid_gym.__file__).parent, shutil.ignore_patterns("__pycache__")
    shutil.copytree(source, package / "satid_gym", ignore=left_out)
    places = [folder, *(path for path in package.rglob("*") if path.is_dir())]
    for place in places:
        (place / "__pycache__").write_text("a file where the folder would have to be")
    nowhere = {"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": str(folder / "tiny.py"), "HOME": str(folder / "tiny.py")}
    assert call(folder, "import satid_gym.policies", package, **nowhere) == []
    (line,) = call(folder, CALL, package, **nowhere)
    assert "compiling its core for this machine, about 50 s, in every process" in line
    assert "set NUMBA_CACHE_DIR to a folder that can" in line
    assert [text.startswith(COMPILING) for text in call(folder, CALL, package)] == [True]
