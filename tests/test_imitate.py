"""Imitation: what the teacher said is what it would fly, a network learns it, and a stopped run ends the same."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.training import imitation
from agents.training.imitation import ImitationSettings
from agents.training.run import Run
from agents.training.teacher import teach
from baselines.command.cli import exit_code
from satid_gym import SATELLITES
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.problem import problem

pytestmark = pytest.mark.slow  # trains

SMALL = ImitationSettings(
    satellite="cubesat",
    wheel_scales=(1.0,),
    rounds=3,
    episodes=4,
    edits=2,
    evaluation_episodes=2,
    hidden=(16,),
    epochs=4,
)
LAYOUT = problem(include_covariance=True).layout
SIZE = max(place.stop for place in LAYOUT.values())


def run(folder: Path, *, resume: bool = False, settings: ImitationSettings = SMALL) -> None:
    imitation.train(Run(settings, folder, resume=resume, module="test"))


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """Exit code of `python -m agents.imitate`."""
    monkeypatch.setattr(sys, "argv", ["imitate", *arguments])
    return exit_code(imitation.main)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run that went to its end."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    run(folder)
    return folder


@pytest.mark.parametrize("stopped", [0, 1, 2])
def test_a_stopped_run_goes_on_with_the_same_result(finished, stopped, tmp_path):
    folder = shutil.copytree(finished, tmp_path / "stopped")
    for path in [*folder.glob("policy*"), *(folder / f"round-{i:02d}.npz" for i in range(stopped, 3))]:
        path.unlink()
    run(folder, resume=True)
    for path in ("policy.safetensors", *(f"round-{i:02d}.npz" for i in range(3))):
        assert (folder / path).read_bytes() == (finished / path).read_bytes(), path
    rows = [json.loads((f / "curve.json").read_text())["curve"] for f in (finished, folder)]
    without_seconds = [[{k: v for k, v in row.items() if k != "seconds"} for row in curve] for curve in rows]
    assert without_seconds[0] == without_seconds[1]
    assert [row["round"] for row in rows[1]] == [0, 1, 2]


def test_the_run_folder_tells_how_it_came_about(finished):
    head = json.loads((finished / "run.json").read_text())
    assert ImitationSettings.from_dict(head["settings"]) == SMALL
    assert "torch" in head["versions"]
    policy = LearnedPolicy.load(finished / "policy")
    assert policy.include_covariance
    assert ImitationSettings.from_dict(policy.details["trained"]["settings"]) == SMALL
    assert (finished / "curve.csv").read_text().startswith("round,decisions,seconds,satellite,")


def test_folders_in_use_or_without_a_run_are_refused(finished, tmp_path, monkeypatch, capsys):
    with pytest.raises(ValueError, match="add --resume"):
        run(finished)
    for arguments, words in (
        (["--run", str(tmp_path), "--resume"], "holds no run to resume"),
        (["--run", str(finished), "--resume", "--rounds", "4"], "nothing else"),
    ):
        assert command(monkeypatch, *arguments) == 2
        assert words in capsys.readouterr().err


def test_a_finished_run_is_left_as_it_is(finished, tmp_path, monkeypatch, capsys):
    folder = shutil.copytree(finished, tmp_path / "copy")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert command(monkeypatch, "--run", f"{folder}/", "--resume") == 0
    assert "has had its 3 rounds already" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_damaged_round_is_refused_and_without_it_the_run_goes_on(finished, tmp_path, monkeypatch, capsys):
    folder = shutil.copytree(finished, tmp_path / "copy")
    damaged = folder / "round-01.npz"
    content = bytearray(damaged.read_bytes())
    content[len(content) // 2] ^= 1
    damaged.write_bytes(content)
    assert command(monkeypatch, "--run", str(folder), "--resume") == 2
    assert "round-01.npz is damaged" in capsys.readouterr().err
    damaged.unlink()  # the round after it is flown again as well
    assert command(monkeypatch, "--run", str(folder), "--resume") == 0
    for name in ("policy.safetensors", "round-01.npz", "round-02.npz"):
        assert (folder / name).read_bytes() == (finished / name).read_bytes()


@pytest.mark.parametrize(("mode", "walk"), [("step", 0.0012), ("drift", 0.0003)])
def test_the_teacher_says_what_it_flies(mode: str, walk: float) -> None:
    """Without a network the teacher's flight is that of the policy in the same episodes, told the mode's walk.

    Few of its sides are worth less than their opposites: the search has not tried everything.
    """
    settings = ImitationSettings(episodes=2, inertia=mode)
    observations, advantages = teach(None, SATELLITES["smallsat"], (mode,), settings, 40)

    class Listening(MPCPolicy):
        include_covariance = True
        heard: list[np.ndarray] = []

        def plan(self, observation: np.ndarray) -> np.ndarray:
            command = super().plan(observation)
            self.heard.append(np.concatenate([observation, command], axis=1))
            return command

    policy = Listening(steps=settings.steps, edits=settings.edits, margin=settings.margin, walk=walk)
    fly(policy, satellite="smallsat", inertia=mode, seeds=seeds("training", 2, 40))
    heard = np.concatenate(policy.heard)
    np.testing.assert_array_equal(observations, heard[:, :SIZE])
    commands = heard[:, SIZE:]
    assert 0.0 < np.mean((advantages > 0.0) != (commands > 0.0)) < 0.1
    assert np.mean(np.maximum(-advantages * commands, 0.0)) < 0.1 * np.mean(np.abs(advantages))


def test_a_network_flies_what_the_teacher_does_not() -> None:
    class Still:
        def __call__(self, observation: np.ndarray) -> np.ndarray:
            return np.zeros((len(observation), 3))

    settings = ImitationSettings(episodes=8, edits=1, taught=0.4)
    observations, advantages = teach(Still(), SATELLITES["cubesat"], INERTIA_MODES, settings, 0)  # type: ignore[arg-type]
    rates = np.abs(observations.reshape(4, -1, 2, SIZE)[:, 50:, :, LAYOUT["rate"]]).mean(axis=(1, 3)).ravel()
    assert sorted(set(np.where(rates < 0.2, "network", np.where(rates > 0.6, "teacher", "neither")))) == [
        "network",
        "teacher",
    ]
    assert advantages.shape == (len(observations), 3)


def test_a_network_learns_which_side_and_when_the_end_comes() -> None:
    """The second output turns 8 decisions before the end, which a plain first layer would hardly see in 1/300ths."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((40_000, SIZE)).astype(np.float32)
    clock = LAYOUT["time_left"].start
    x[:, clock] = rng.integers(0, 300, len(x)) / 300.0
    ending = x[:, clock] < 8.5 / 300.0
    sides = np.stack([x[:, 0] + x[:, 3] > 0.0, ending, x[:, 5] - 2.0 * x[:, 9] > 0.5], axis=1)
    settings = ImitationSettings(hidden=(32, 32))
    network = imitation.fit([(x, np.where(sides, 1.0, -1.0).astype(np.float32))], settings, 12)
    agree = (network(x) > 0.0) == sides
    assert agree[:, 0].mean() > 0.98
    assert agree[:, 2].mean() > 0.9
    assert agree[ending, 1].mean() > 0.9
    assert agree[~ending, 1].mean() > 0.99
    decided = np.abs(network(x)[:, 0]) > 1.0
    assert decided.mean() > 0.9  # commands go to the limit


def test_what_matters_outweighs_what_does_not() -> None:
    """Told opposites about the same observations, the network takes the side that is worth more."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((30_000, SIZE)).astype(np.float32)
    worth = np.where(rng.random((len(x), 3)) < 0.25, 9.0, -1.0).astype(np.float32)  # mostly against, but not by worth
    network = imitation.fit([(x, np.sign(x[:, :3]) * worth)], ImitationSettings(hidden=(16,)), 8)
    clear = np.abs(x[:, :3]) > 0.3
    assert ((network(x) > 0.0) == (x[:, :3] > 0.0))[clear].mean() > 0.9


def test_what_was_learned_finds_the_inertia(tmp_path):
    """A short run on one satellite is already near the closed-loop square wave."""
    settings = ImitationSettings(
        satellite="microsat", wheel_scales=(1.0,), rounds=5, episodes=20, edits=6, evaluation_episodes=8
    )
    run(tmp_path / "run", settings=settings)
    policy = LearnedPolicy.load(tmp_path / "run" / "policy")
    cell = {"satellite": "microsat", "inertia": "static", "seeds": seeds("validation", 16)}
    scores = fly(policy, scenario=benchmark_scenario(), **cell).scores()
    assert scores["final_error"].mean() < 0.002
    assert scores["outside_fraction"].mean() < 0.01
    teacher = fly(MPCPolicy(edits=6), scenario=benchmark_scenario(), **cell).scores()
    assert scores["final_error"].mean() < 1.5 * teacher["final_error"].mean()


def test_settings_are_checked() -> None:
    for changes, words in (
        ({"rounds": 0}, "rounds must be an integer of at least 1, got 0"),
        ({"taught": 1.5}, "taught must be finite and at least 0 and at most 1"),
        ({"satellite": "cube"}, "unknown satellite 'cube'"),
        ({"inertia": "stepp"}, "unknown inertia mode 'stepp'"),
        ({"scenario": "adaptive"}, "unknown scenario 'adaptive'"),
        ({"episodes": 3}, "must be an integer of at least 4, got 3"),
        ({"walks": (0.001,)}, "walks must be 4 numbers, one for each of"),
        ({"walks": (0.001, 0.001, -0.001, 0.001)}, "walks must be finite and at least 0"),
    ):
        with pytest.raises(ValueError, match=words):
            ImitationSettings(**changes)
