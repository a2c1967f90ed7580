"""Command runner: settings from the command line, and how a command ends."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from baselines.command import cli, provenance
from baselines.command.provenance import result_head

ROOT = Path(__file__).parent.parent


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Of the test."""

    count: int = 1
    """How many."""
    output: Path = Path("out.json")
    """Where to."""

    def check(self) -> None:
        if self.count < 1:
            raise ValueError("count must be at least 1")


class Counted(Settings):
    """Settings that count the arguments."""

    @classmethod
    def parse(cls, arguments):
        return cls(count=len(arguments))


def ending(main, monkeypatch, capsys, *arguments):
    """Exit code and standard error of a command."""
    monkeypatch.setattr(sys, "argv", ["test", *arguments])
    code = cli.exit_code(main)
    return code, capsys.readouterr().err


def test_settings_are_parsed_and_checked_before_the_command_runs(monkeypatch, capsys):
    seen = []

    def main(settings: Settings) -> None:
        seen.append(settings)

    assert ending(main, monkeypatch, capsys, "--count", "3") == (0, "")
    assert seen == [Settings(count=3)]
    assert ending(main, monkeypatch, capsys, "--count", "0") == (2, "error: count must be at least 1\n")
    with pytest.raises(SystemExit) as end:
        ending(main, monkeypatch, capsys, "--cuont", "3")
    assert end.value.code == 2
    assert len(seen) == 1


def test_a_settings_class_may_parse_by_itself(monkeypatch, capsys):
    def main(settings: Counted) -> int:
        return settings.count

    assert ending(main, monkeypatch, capsys, "a", "b") == (2, "")


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (KeyboardInterrupt(), 130, "\nstopped; existing files are unchanged\n"),
        (KeyboardInterrupt("go on with --resume"), 130, "\nstopped; go on with --resume\n"),
        (cli.UserError("no such policy"), 2, "error: no such policy\n"),
        (PermissionError(13, "Permission denied", "x"), 2, "error: x: Permission denied\n"),
    ],
)  # fmt: skip
def test_what_ends_a_command_is_a_line_and_an_exit_code(raised, code, said, monkeypatch, capsys):
    def main() -> None:
        raise raised

    assert ending(main, monkeypatch, capsys) == (code, said)


def test_the_text_after_ctrl_c_is_the_commands_own(monkeypatch, capsys):
    @cli.on_interrupt("no video was written")
    def main() -> None:
        raise KeyboardInterrupt

    assert ending(main, monkeypatch, capsys) == (130, "\nstopped; no video was written\n")


def test_a_value_error_is_the_users_only_where_a_command_says_so(monkeypatch, capsys):
    def main() -> None:
        with cli.user_errors():
            int("1")
        raise ValueError("a bug")

    with pytest.raises(ValueError, match="a bug"):
        ending(main, monkeypatch, capsys)


def test_a_reader_that_has_had_enough_ends_a_command_silently():
    code = "from baselines.command import cli\ndef main():\n    for i in range(100_000): print(i)\ncli.run(main)"
    line = f"{sys.executable} -c '{code}' | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (141, "0\n", "")


@pytest.mark.parametrize("module", ["agents.train", "agents.compare", "agents.standing", "agents.evaluate"])
def test_the_help_says_how_a_command_is_called(module):
    done = subprocess.run([sys.executable, "-m", module, "--help"], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.startswith(f"usage: python -m {module} [-h]"), done.stdout[:200] + done.stderr


def test_the_head_of_results_says_where_they_come_from(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["x", "--count", "2", "--output", "/home/me/out.json"])
    head = result_head("some.module", Settings(output=Path("/home/me/out.json")), split="test", seeds=range(7, 12))
    assert list(head) == ["command", "revision", "versions", "settings", "seeds"]
    assert head["command"] == "python -m some.module --count 2 --output out.json"
    assert head["settings"] == {"count": 1, "output": "out.json"}
    assert head["seeds"] == {"split": "test", "first": 7, "count": 5}
    assert set(result_head("some.module", packages=["numpy"])["versions"]) == {"python", "numpy"}


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A checkout of one commit in place of this one: its git command and the committed file."""

    def git(*arguments):
        subprocess.run(["git", "-c", "user.name=x", "-c", "user.email=x@y", *arguments], cwd=tmp_path, check=True)

    monkeypatch.setattr(provenance, "_ROOT", tmp_path)
    provenance.checkout.cache_clear()
    (tmp_path / "out put.json").write_text("{}")
    git("init", "--quiet")
    git("add", ".")
    git("commit", "--quiet", "--message", "first")
    yield git, tmp_path / "out put.json"
    provenance.checkout.cache_clear()


def test_the_revision_of_results_is_that_of_the_code_that_began(repository, monkeypatch, capsys):
    git, file = repository
    seen = []

    def main() -> None:
        file.write_text("changed")
        git("commit", "--quiet", "--all", "--message", "while it runs")
        seen.append(provenance.revision())

    first = provenance.revision()
    provenance.checkout.cache_clear()
    assert ending(main, monkeypatch, capsys) == (0, "")
    assert seen == [first]
    provenance.checkout.cache_clear()
    assert provenance.revision() != first


def test_a_checkout_with_changes_is_dirty_but_for_the_output(repository):
    _, file = repository
    file.write_text("changed")
    found = provenance.revision()
    assert found.endswith("-dirty")
    assert provenance.revision(file) == found.removesuffix("-dirty")
    assert provenance.revision(file.with_name("other.json")) == found
