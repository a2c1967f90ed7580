"""Policies of the user's own code by module:name: who makes them, what is refused, and the commands that fly them."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import sys
import textwrap

import numpy as np
import pytest

from agents.benchmark import compare, evaluate
from agents.benchmark.entrants import entrant
from agents.standing import table
from agents.standing.table import Table
from baselines.command.cli import exit_code
from satid_gym.commands.main import main as satid
from satid_gym.policies.custom import custom, digest, find_any
from satid_gym.policies.learned.shipped import find
from tests.cases import cases

CODE = textwrap.dedent('''
    import functools
    import numpy as np
    from satid_gym.policy import check_commands_rates

    class Spin:
        """Constant command on all wheels, or about all axes of the body."""

        kind = "scripted"

        def __init__(self, name="spin", share=0.02, rates=False):
            self.name, self.share, self.rates = name, share, rates

        def reset(self, mission, seeds):
            if self.rates:
                check_commands_rates(mission, self.name)
            self.actions = mission.actions

        def __call__(self, observation):
            return np.full((len(observation), self.actions), self.share)

    def by_rates():
        return Spin("spin_rates", 0.3, rates=True)

    def wants(share):
        return Spin(share=share)

    FASTER = Spin("faster", 0.05)
    nameless = type("Nameless", (Spin,), {"__init__": lambda self: Spin.__init__(self, name="no name")})
    kindless = functools.partial(type("Kindless", (Spin,), {"kind": "mine"}))
    NUMBER = 3
''')


@pytest.fixture(autouse=True)
def module(tmp_path, monkeypatch):
    (tmp_path / "my_policies.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("my_policies", None)


def call(main, line):
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as output:
        patch.setattr(sys, "argv", ["command", *line.split()])
        return exit_code(main), output.getvalue()


def test_a_class_a_function_or_an_object_is_a_policy_and_can_have_another_name():
    assert custom("my_policies:Spin").name == "spin"
    assert custom("my_policies:by_rates").rates
    assert custom("my_policies:FASTER").share == 0.05
    assert find_any("other=my_policies:Spin").name == "other"
    assert find_any("generalist").name == "generalist"


@cases(
    ("text", "message"),
    [
        ("my_policies:wants", "missing a required argument: 'share'.*functools.partial"),
        ("my_policies:NUMBER", "3 is not made without arguments|not a callable"),
        ("my_policies:nameless", "a policy's name is .* got 'no name'"),
        ("my_policies:kindless", "kind must be one of scripted, closed_loop, learned, reference"),
        ("my_policies:Spim", "Spim.*Spin"),
        ("no_such_module:Spin", "cannot import no_such_module"),
        ("a name=my_policies:Spin", "a policy's name is"),
    ],
)
def test_what_is_no_policy_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        find_any(text)


def test_the_digest_is_of_the_settings_too_and_the_module_keeps_its_object(module):
    made = "from satid_gym.policies import build\nMINE = build('rate_square', {'period': 12.0, 'margin': 2.5})\n"
    (module / "my_policies.py").write_text(made)
    first = digest(find_any("mine=my_policies:MINE"))
    assert sys.modules["my_policies"].MINE.name == "rate_square"
    (module / "my_policies.py").write_text(made.replace("12.0", "24.0"))
    assert digest(find_any("my_policies:MINE")) != first


def test_find_runs_no_code():
    with pytest.raises(ValueError, match="no such file either"):
        find("my_policies:Spin")
    assert "my_policies" not in sys.modules


def test_a_baselines_name_is_taken():
    with pytest.raises(ValueError, match=r"has the name 'mpc'.*NAME=my_policies:Spin"):
        entrant("mpc=my_policies:Spin")


def test_the_comparison_flies_it_and_says_of_what_code(module):
    line = "--satellites microsat --modes static --episodes 2 --seed-split validation --output ."
    code, printed = call(compare.main, f"--policies zero my_policies:Spin quick=my_policies:FASTER {line}")
    assert code == 0
    results = json.loads((module / "compare.json").read_text())
    assert [record["policy"] for record in results["records"]] == ["zero", "spin", "quick"]
    sha256 = hashlib.sha256(CODE.encode()).hexdigest()
    assert results["definitions"]["policies"]["quick"] == {"sha256": sha256, "module": "my_policies:FASTER"}
    assert "quick" in printed


def test_the_evaluation_flies_it_next_to_a_baseline(module):
    line = "--satellites microsat --modes static --episodes 2 --against zero"
    code, printed = call(evaluate.main, f"my_policies:Spin {line}")
    assert code == 0
    assert "my_policies:Spin: 2 episodes" in printed


def test_one_that_commands_rates_is_refused_by_torque_and_flies_by_rates(module, capsys):
    line = "--satellites microsat --modes static --episodes 2 --output ."
    assert call(compare.main, f"--policies zero my_policies:by_rates {line}")[0] == 2
    assert 'spin_rates commands body rates: make the environment with control="rate"' in capsys.readouterr().err
    args = ["fly", "--satellite", "microsat", "--inertia", "static", "--policy", "my_policies:by_rates"]
    assert satid([*args, "--control", "rate"]) == 0
    assert "spin_rates" in capsys.readouterr().out
    assert satid(args) == 2
    assert "commands body rates" in capsys.readouterr().err


def test_the_standing_table_flies_it_again_when_its_code_changes(module):
    small = Table(
        scenarios=("default",), satellites=("microsat",), inertias=("static",), policies=("my_policies:by_rates",),
        planners=False, episodes=2, split="validation",
    )  # fmt: skip
    small.check()
    task = next(task for task in small.tasks() if task.name == "spin_rates")
    result = task.run(module / "flights")["result"]
    assert np.isfinite(result["expected"]).all()
    assert task.kept(module / "flights")["result"] == result
    (module / "my_policies.py").write_text(CODE.replace("0.3", "0.4"))
    again = next(task for task in small.tasks() if task.name == "spin_rates")
    assert again.kept(module / "flights") is None
    assert table.misfit(task.policy, task.cell) == ""
