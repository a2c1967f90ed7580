"""Combined runs: one network learns what was said in all of them, and runs that do not belong together are refused."""

from __future__ import annotations

import dataclasses
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.training import combine, imitation
from agents.training.imitation import ImitationSettings
from agents.training.run import Run
from agents.training.teacher import answers
from baselines.command.cli import exit_code
from satid_gym.policies.learned import LearnedPolicy

pytestmark = pytest.mark.slow  # trains

SMALL = ImitationSettings(
    satellite="cubesat",
    wheel_scales=(1.0,),
    rounds=2,
    episodes=4,
    edits=2,
    steps=1,
    evaluation_episodes=2,
    hidden=(16,),
    epochs=8,
)


def imitated(folder: Path, **changes: object) -> Path:
    settings = dataclasses.replace(SMALL, **changes)  # type: ignore[arg-type]
    imitation.train(Run(settings, folder, resume=False, module="test"))
    return folder


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two finished runs with different seeds."""
    folder = tmp_path_factory.mktemp("runs")
    return [imitated(folder / f"seed-{seed}", seed=seed) for seed in (0, 1)]


def agreement(network, run: Path) -> float:
    """Share of a run's answers that the network gives."""
    said = answers(run, SMALL.rounds)
    return float(np.mean([np.mean((network(x) > 0.0) == (y > 0.0)) for x, y in said]))


def test_the_network_learns_from_every_run(runs, tmp_path, monkeypatch, capsys):
    folder = tmp_path / "combined"
    monkeypatch.setattr(sys, "argv", ["combine", *map(str, runs), "--run", str(folder), "--epochs", "8"])
    assert exit_code(combine.main) == 0
    assert "5 k decisions of the teacher fitted" in capsys.readouterr().out
    policy = LearnedPolicy.load(folder / "policy")
    trained = policy.details["trained"]
    assert trained["combined_seeds"] == [0, 1]
    assert trained["decisions"] == 2 * SMALL.rounds * SMALL.episodes * 300
    assert ImitationSettings.from_dict(trained["settings"]) == SMALL
    assert "--epochs 8" in trained["command"]
    assert "torch" in trained["versions"]
    first, second = (LearnedPolicy.load(run / "policy") for run in runs)
    assert agreement(policy.network, runs[1]) > agreement(first.network, runs[1]) + 0.02
    assert agreement(policy.network, runs[0]) > agreement(second.network, runs[0]) + 0.02
    said = [piece for run in runs for piece in answers(run, SMALL.rounds)]
    again = imitation.fit(said, SMALL, 8)
    np.testing.assert_array_equal(policy.network(said[0][0]), again(said[0][0]))


def test_runs_that_do_not_belong_together_are_refused(runs, tmp_path):
    other = imitated(tmp_path / "other", seed=2, edits=1)
    for folders, words in (
        ([], "name at least one run"),
        ([runs[0], tmp_path / "nowhere"], "holds no run"),
        ([runs[0], other], "other has other settings than"),
        ([runs[0], runs[0]], "same seed"),
    ):
        with pytest.raises(ValueError, match=words):
            combine.settings_of(folders)


def test_a_run_that_is_not_finished_is_refused(runs, tmp_path):
    unfinished = shutil.copytree(runs[1], tmp_path / "unfinished")
    (unfinished / "round-01.npz").unlink()
    with pytest.raises(ValueError, match="unfinished has 1 of its 2 rounds: go on with it by"):
        combine.answers_of([runs[0], unfinished], SMALL.rounds)


def test_a_folder_in_use_is_left_as_it_is(runs, monkeypatch, capsys):
    before = {path.name: path.read_bytes() for path in runs[1].iterdir()}
    monkeypatch.setattr(sys, "argv", ["combine", *map(str, runs), "--run", str(runs[1])])
    assert exit_code(combine.main) == 2
    assert "holds a run already" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in runs[1].iterdir()} == before
