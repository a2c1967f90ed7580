"""Commands: what is misspelt or out of range is one line on standard error and an exit code, before any work."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from satid_gym import SatInertiaIDVectorEnv, warmup

pytestmark = pytest.mark.compiled  # without the compiler there is nothing of the library to see here

ROOT = Path(__file__).parent.parent
PROTOCOL = "mutation.trial"  # a child process, which is spoken to by its standard input
COMMANDS = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__"): path
    for folder in ("agents", "baselines", "tests")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if '\nif __name__ == "__main__":\n' in path.read_text(encoding="utf-8")
}
MISTAKES = [
    ("agents.compare --scenario tihgt", "unknown scenario 'tihgt'", "Did you mean 'tight'?"),
    ("agents.compare --policies rate_squares", "no such file either", "Did you mean 'rate_square'?"),
    ("agents.compare --episodes 1", "at least 2"),
    ("agents.evaluate generalist --modes stepp", "unknown inertia mode 'stepp'", "Did you mean 'step'?"),
    ("agents.imitate --edits 0", "edits must be an integer of at least 1, got 0"),
    ("agents.train --settings ppos", "'ppos'", "Did you mean 'ppo'?"),
    ("agents.training.select nowhere", "nowhere"),
    ("agents.verdict --results nowhere", "nowhere/compare.json is missing"),
    ("baselines.studies.observability --torque nan", "torque must be finite"),
    ("baselines.tune --satellites", "name at least one satellite"),
    ("baselines.tuning.open_loop_design --elite 65", "elite must be at most 64, got 65"),
    ("tests.golden --output file/golden.json", "file: File exists"),
]


def run(command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> tuple[int, str]:
    """Exit code and standard error of `python -m` command, in this process."""
    module, *arguments = command.split()
    monkeypatch.setattr(sys, "argv", [module, *arguments])
    with pytest.raises(SystemExit) as end:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    errors = capsys.readouterr().err
    return int(end.value.code or 0), errors


@pytest.fixture
def errors_of(tmp_path, capsys, monkeypatch):
    """Standard error of a command that ends with code 2 before it flies or writes anything."""

    def work(*_, **__):
        raise AssertionError("work had begun")

    monkeypatch.setattr(SatInertiaIDVectorEnv, "reset", work)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")

    def errors(command):
        code, said = run(command, capsys, monkeypatch)
        assert code == 2
        assert not [path for path in tmp_path.rglob("*") if path.is_file() and path.name != "file"]
        return said

    return errors


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
@pytest.mark.parametrize(("command", "expected"), [(command, words) for command, *words in MISTAKES])
def test_what_cannot_be_done_is_one_line_before_any_work(command, expected, errors_of):
    errors = errors_of(command)
    assert errors.count("\n") == 1, errors
    for words in expected:
        assert words in errors


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
@pytest.mark.parametrize("command", [name for name in COMMANDS if not name.endswith(PROTOCOL)])
def test_every_command_is_tried(command, errors_of):
    """Every command goes through the runner, which refuses what is missing or unknown."""
    assert "    cli.run(main)\n" in COMMANDS[command].read_text(encoding="utf-8")
    errors = errors_of(f"{command} --no-such-option")
    assert "--no-such-option" in errors or "Missing argument" in errors


def test_the_core_is_compiled_ahead_for_a_satellite_in_a_scenario(capsys):
    assert warmup.main(["--satellite", "cubesat", "--scenario", "tight", "--control", "rate"]) == 0
    assert "core ready after" in capsys.readouterr().out
    assert warmup.main(["--satellite", "nosuch"]) == 2
    assert "unknown satellite 'nosuch'" in capsys.readouterr().err
