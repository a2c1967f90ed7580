"""The README: its figures are those of the committed results. Its code and commands: test_docs.py."""

import json
import re

import pytest

from agents import readme

TEXT = (readme.ROOT / "README.md").read_text()


def test_its_figures_are_those_of_the_committed_results():
    assert readme.written(TEXT) == TEXT


def test_its_first_commands_are_targets_of_the_makefile():
    commands = re.search(r"```\n(.*?)```", TEXT, flags=re.DOTALL).group(1).split("\n")
    makefile = (readme.ROOT / "Makefile").read_text()
    for line, target in zip(commands, ("compare", "test"), strict=False):
        assert line.startswith(f"make {target}")
        assert re.search(rf"^{target}: setup", makefile, flags=re.MULTILINE)


def test_the_table_is_made_of_means_over_satellites():
    """Rows by kind, then by the geometric mean over modes: c is ahead of a, which has less in the mean."""
    flown = {"a": ("scripted", 0.01, 0.03), "b": ("learned", 0.001, 0.002), "c": ("scripted", 0.001, 0.05)}
    records = [
        {
            "policy": policy,
            "kind": kind,
            "satellite": satellite,
            "inertia_mode": mode,
            "final_error_mean": factor * error,
            "outside_fraction": 0.01 * factor,
        }
        for policy, (kind, *errors) in flown.items()
        for satellite, factor in (("s", 0.5), ("t", 1.5))
        for mode, error in zip(("static", "step"), errors, strict=True)
    ]
    table = readme.results_table(
        {"records": records, "revision": "r", "command": "python -m agents.compare --output x"}
    )
    assert table.splitlines()[0] == "| policy | kind | static | step | outside |"
    assert table.splitlines()[2:5] == [
        "| **b** | learned | 0.100 | 0.200 | 1.0 % |",
        "| c | scripted | 0.100 | 5.00 | 1.0 % |",
        "| a | scripted | 1.00 | 3.00 | 1.0 % |",
    ]
    assert table.endswith("Revision r, python -m agents.compare.")


def test_a_readme_without_its_marks_is_refused():
    with pytest.raises(ValueError, match="must hold the lines"):
        readme.between("nothing", "results", "x")


def test_the_committed_results_name_their_command_and_seeds():
    results = json.loads((readme.RESULTS / "compare.json").read_text())
    assert results["command"].startswith("python -m agents.compare")
    assert results["seeds"]["split"] == "test"
