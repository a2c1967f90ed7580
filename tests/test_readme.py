"""The README: its figures are those of the committed results. Its code and commands: test_docs.py."""

import json
import re

import pytest

from agents.docs import readme, results_tables

TEXT = (readme.ROOT / "README.md").read_text()


def test_its_figures_are_those_of_the_committed_results():
    assert readme.written(TEXT) == TEXT


def test_its_first_commands_are_targets_of_the_makefile():
    blocks = re.findall(r"^```(.*?)\n(.*?)^```$", TEXT, flags=re.DOTALL | re.MULTILINE)
    commands = next(body for language, body in blocks if not language).split("\n")
    makefile = (readme.ROOT / "Makefile").read_text()
    for line, target in zip(commands, ("compare", "test"), strict=False):
        assert line.startswith(f"make {target}")
        assert re.search(rf"^{target}: setup", makefile, flags=re.MULTILINE)


def test_the_table_is_made_of_means_over_satellites():
    """Rows by kind, then by the geometric mean over modes: c is ahead of a, which has less in the mean."""
    flown = {"a": ("reference", 0.01, 0.03), "b": ("learned", 0.001, 0.002), "c": ("reference", 0.001, 0.05)}
    records = [
        {
            "policy": policy,
            "kind": kind,
            "satellite": satellite,
            "inertia_mode": mode,
            **{f"final_error_{end}": factor * error for end in ("mean", "lo", "hi")},
            "outside_fraction": 0.01 * factor,
            "saturated_fraction": 0.0,
            "reward": 10.0 * factor,
        }
        for policy, (kind, *errors) in flown.items()
        for satellite, factor in (("s", 0.5), ("t", 1.5))
        for mode, error in zip(("static", "step"), errors, strict=True)
    ]
    results = {"records": records, "revision": "r", "command": "python -m agents.compare --output x"}
    table = results_tables.error_table(results)
    assert table.splitlines()[0] == "| policy | kind | static | step | cells inside | mean rank |"
    assert table.splitlines()[2:5] == [
        r"| **b** | learned | 0.100\* [0.100 0.100] | 0.200\* [0.200 0.200] | 2 of 4 | 1.0 |",
        r"| c | reference | 0.100\* [0.100 0.100] | 5.00\* [5.00 5.00] | 2 of 4 | 2.5 |",
        r"| a | reference | 1.00\* [1.00 1.00] | 3.00\* [3.00 3.00] | 2 of 4 | 2.5 |",
    ]
    assert table.endswith("Revision r, python -m agents.compare.")
    assert r"| **b** | learned | 10.0\* | 10.0\* |" in results_tables.reward_table(results)


def test_it_begins_with_the_environment_and_what_it_pays_for():
    first = re.search(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)
    assert len([line for line in first.group(1).splitlines() if line]) == 3
    assert "gymnasium.make(" in first.group(1)
    assert TEXT.index("The reward is") > first.end()
    assert TEXT.index("The reward is") < TEXT.index("<!-- results:")


def test_a_readme_without_its_marks_is_refused():
    with pytest.raises(ValueError, match="must hold the lines"):
        readme.between("nothing", "results", "x")


def test_the_committed_results_name_their_command_and_seeds():
    results = json.loads((readme.RESULTS / "compare.json").read_text())
    assert results["command"].startswith("python -m agents.compare")
    assert results["seeds"]["split"] == "test"
