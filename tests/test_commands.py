"""Commands: what is misspelt or out of range is one line on standard error and an exit code, before any work."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from satid_gym import SatInertiaIDVectorEnv

pytestmark = pytest.mark.compiled  # without the compiler there is nothing of the library to see here

ROOT = Path(__file__).parent.parent
MISSPELT = [
    ("agents.training.select", "name at least one run"),
    ("agents.training.select nowhere", "nowhere"),
    ("agents.training.select nowhere --episodes 0", "episodes must be an integer of at least 1, got 0"),
    ("agents.training.combine", "name at least one run"),
    ("agents.training.combine nowhere --epochs 0", "epochs must be an integer of at least 1, got 0"),
    ("agents.compare --scenario tihgt", "unknown scenario 'tihgt'", "Did you mean 'tight'?"),
    ("agents.compare --satellites", "name at least one satellite"),
    (
        "agents.compare --policies rate_squares",
        "unknown policy (no such file either) 'rate_squares'",
        "Did you mean 'rate_square'?",
    ),
    ("agents.compare --seed-split tests", "unknown split of seeds 'tests'", "Did you mean 'test'?"),
    ("agents.compare --episodes 1", "at least 2"),
    ("agents.evaluate generalists", "'generalists'", "Did you mean 'generalist'?"),
    ("agents.evaluate generalist --modes stepp", "unknown inertia mode 'stepp'", "Did you mean 'step'?"),
    ("agents.export generalists net.onnx", "'generalists'", "Did you mean 'generalist'?"),
    ("agents.benchmark.faults --cases nnoe", "unknown case 'nnoe'", "Did you mean 'none'?"),
    ("agents.imitate --satellite microsats", "'microsats'", "Did you mean 'microsat'?"),
    ("agents.imitate --edits 0", "edits must be an integer of at least 1, got 0"),
    ("agents.record generalist --beside chrip", "'chrip'", "Did you mean 'chirp'?"),
    ("agents.report --scenario tihgt", "unknown scenario 'tihgt'", "Did you mean 'tight'?"),
    ("agents.train --settings ppos", "'ppos'", "Did you mean 'ppo'?"),
    ("agents.train --satellite microsats", "'microsats'", "Did you mean 'microsat'?"),
    ("agents.verdict --results nowhere", "nowhere/compare.json is missing"),
    ("agents.watch generalist --satellite microsats", "'microsats'", "Did you mean 'microsat'?"),
    (
        "baselines.tuning.open_loop_design --satellites microsats",
        "unknown satellite 'microsats'",
        "Did you mean 'microsat'?",
    ),
    ("baselines.tuning.open_loop_design --scenarios defualt", "unknown scenario 'defualt'", "Did you mean 'default'?"),
    ("baselines.tuning.open_loop_design --elite 65", "elite must be at most 64, got 65"),
    ("baselines.tuning.open_loop_design --fraction 0", "fraction must be finite and more than 0 and at most 1"),
    (
        "baselines.studies.efficiency --satellites microsats",
        "unknown satellite 'microsats'",
        "Did you mean 'microsat'?",
    ),
    ("baselines.studies.efficiency --policies chrip", "unknown policy 'chrip'", "Did you mean 'chirp'?"),
    ("baselines.tuning.filter_sensitivity --policies chrip", "unknown policy 'chrip'", "Did you mean 'chirp'?"),
    ("baselines.studies.efficiency --reference rate_squares", "'rate_squares'", "Did you mean 'rate_square'?"),
    ("baselines.studies.efficiency --episodes 0", "episodes must be an integer of at least 1, got 0"),
    ("baselines.studies.faults --satellites microsats", "unknown satellite 'microsats'", "Did you mean 'microsat'?"),
    ("baselines.studies.faults --policies chrip", "unknown baseline 'chrip'", "Did you mean 'chirp'?"),
    ("baselines.studies.faults --inertia drfit", "unknown inertia mode 'drfit'", "Did you mean 'drift'?"),
    (
        "baselines.studies.observability --satellite microsats",
        "unknown satellite 'microsats'",
        "Did you mean 'microsat'?",
    ),
    ("baselines.studies.observability --torque nan", "torque must be finite"),
    ("baselines.paper --seeds 0", "seeds must be an integer of at least 1, got 0"),
    ("baselines.timing --satellite microsats", "unknown satellite 'microsats'", "Did you mean 'microsat'?"),
    ("baselines.timing --policies chrip", "unknown policy 'chrip'", "Did you mean 'chirp'?"),
    ("baselines.tune --satellites microsats", "unknown satellite 'microsats'", "Did you mean 'microsat'?"),
    ("baselines.tune --scenarios defualt", "unknown scenario 'defualt'", "Did you mean 'default'?"),
    ("baselines.tune --satellites", "name at least one satellite"),
    ("tests.qa.interruption --kills 0", "kills must be an integer of at least 1, got 0"),
    ("tests.qa.fuzz --wheels 2", "wheels must be an integer of at least 3, got 2"),
    ("tests.qa.fuzz --only 10000", "only must be at most 9999, got 10000"),
    ("tests.golden --output file/golden.json", "file: File exists"),
    ("tests.qa.interval_coverage --satellite microsats", "unknown satellite 'microsats'", "Did you mean 'microsat'?"),
    ("tests.qa.interval_coverage --inertia stepp", "unknown inertia mode 'stepp'", "Did you mean 'step'?"),
    ("tests.qa.long_haul --decisions 5", "decisions must be an integer of at least"),
    ("tests.qa.mutation --modules core/rewards", "unknown module 'core/rewards'", "Did you mean 'core/reward'?"),
]
WITHOUT_NAMES = {
    "agents.docs.tables",
    "agents.readme",
    "agents.docs.reward_figure",
    "agents.docs.limits_figure",
    "agents.docs.decision_figure",
    "agents.docs.faults_table",
    "tests.qa.distribution",
    "tests.qa.mutation.trial",
}


def run(command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> tuple[int, str]:
    """Exit code and standard error of `python -m` command, in this process."""
    module, *arguments = command.split()
    monkeypatch.setattr(sys, "argv", [module, *arguments])
    with pytest.raises(SystemExit) as end:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    errors = capsys.readouterr().err
    if isinstance(end.value.code, str):  # Python prints such a code, and exits with 1
        return 1, errors + end.value.code + "\n"
    return int(end.value.code or 0), errors


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
@pytest.mark.parametrize(("command", "expected"), [(command, words) for command, *words in MISSPELT])
def test_what_cannot_be_done_is_one_line_before_any_work(command, expected, tmp_path, capsys, monkeypatch):
    def work(*_, **__):
        raise AssertionError("work had begun")

    monkeypatch.setattr(SatInertiaIDVectorEnv, "reset", work)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")
    code, errors = run(command, capsys, monkeypatch)
    assert code in (1, 2)
    assert errors.count("\n") == 1, errors
    for words in expected:
        assert words in errors
    assert not [path for path in tmp_path.rglob("*") if path.is_file() and path.name != "file"]


def test_every_command_is_tried():
    folders = [ROOT / name for name in ("agents", "baselines", "tests")]
    found = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__")
        for folder in folders
        for path in folder.rglob("*.py")
        if '\nif __name__ == "__main__":\n' in path.read_text(encoding="utf-8")
    }
    assert found == {command.split()[0] for command, *_ in MISSPELT} | WITHOUT_NAMES
