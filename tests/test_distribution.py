"""Packaging: the short form of `python -m tests.qa.distribution`, which also compiles what it installed."""

import shutil
import sys
from pathlib import Path

import pytest

import satid_gym
from tests.qa.distribution import FLY, ROOT, build, call, contents, first_examples, install, unpack

pytestmark = pytest.mark.slow  # builds and installs


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and sdist of this checkout, and the sdist unpacked."""
    folder = tmp_path_factory.mktemp("dist")
    wheel, sdist = build(ROOT, folder / "first")
    return wheel, sdist, unpack(sdist, folder / "elsewhere")


def test_the_sdist_builds_the_same_bytes_elsewhere(built, tmp_path):
    wheel, sdist, source = built
    (source / "pyproject.toml").touch()  # other times of files make no difference
    again, sdist_again = build(source, tmp_path)
    assert again.read_bytes() == wheel.read_bytes()
    assert sdist_again.read_bytes() == sdist.read_bytes()


def test_wheel_and_sdist_hold_what_they_should_and_can_be_published(built):
    """The wheel the library alone, the sdist what it takes to test."""
    names = contents(built[0])
    assert {name.split("/")[0] for name in names} == {"satid_gym", f"satid_gym-{satid_gym.__version__}.dist-info"}
    assert "satid_gym/py.typed" in names
    assert f"satid_gym-{satid_gym.__version__}.dist-info/licenses/LICENSE" in names
    assert not [name for name in names if "__pycache__" in name or name.endswith((".nbi", ".nbc"))]
    source = built[2]
    policies = (f"satid_gym/policies/{name}.json" for name in ("tuned", "learned/pretrained/ppo"))
    data = ("docs/results/compare.json", *policies, "tests/conftest.py", "constraints.txt")
    for name in ("satid_gym", *data, "Makefile", "LICENSE", "README.md"):
        assert (source / name).exists(), name
    assert not [p.name for p in source.iterdir() if p.name in ("runs", "results", ".venv", "build", "dist")]
    assert call(sys.executable, "-m", "twine", "check", "--strict", *built[:2]).count("PASSED") == 2


def test_the_wheel_alone_is_imported_and_its_environment_registered(built, tmp_path):
    python = install(built[0], tmp_path / "environment")
    code = "import gymnasium, satid_gym; gymnasium.spec('SatInertiaID-v0'); print(satid_gym.__file__)"
    assert str(tmp_path / "environment") in call(python, "-c", code, cwd=tmp_path)
    assert first_examples().count('gymnasium.make("SatInertiaID-v0"') == 2
    for name in ("agents", "baselines", "tests.conftest"):
        with pytest.raises(RuntimeError, match="ModuleNotFoundError"):
            call(python, "-c", f"import {name}", cwd=tmp_path)
    assert call(sys.executable, "-m", "pip", "--python", python, "check") == "No broken requirements found."


def take_kernels(python):
    """What this checkout has compiled, to where the wheel is installed: it is of the same source."""
    code = "import importlib.util as own; print(own.find_spec('satid_gym').origin)"
    own, there = ROOT / "satid_gym", Path(call(python, "-c", code, cwd=python.parent)).parent
    for path in own.rglob("*.nb[ic]"):
        (there / path.relative_to(own)).parent.mkdir(exist_ok=True)
        shutil.copy2(path, there / path.relative_to(own))


@pytest.mark.compiled
def test_the_wheel_alone_flies_what_is_shipped(built, tmp_path):
    python = install(built[0], tmp_path / "environment")
    take_kernels(python)
    assert call(python, "-c", first_examples(), cwd=tmp_path).startswith("relative error")
    flown = call(python, "-c", FLY, cwd=tmp_path).splitlines()
    assert [line.split(":")[0] for line in flown] == ["generalist", "mpc"]


def test_the_citation_names_this_version():
    """And the release that the changelog begins with."""
    assert f"\nversion: {satid_gym.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {satid_gym.__version__} (" in (ROOT / "CHANGELOG.md").read_text()
