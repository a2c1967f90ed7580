"""Settings of training: what cannot be trained is refused in one line before a folder is made."""

import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from agents.training import ppo, run, sac, train
from agents.training.imitation import ImitationSettings
from agents.training.ppo import PPOSettings
from agents.training.run import SCORES, Run, merit
from agents.training.sac import SACSettings
from baselines.command.cli import exit_code
from satid_gym.files import read_json
from tests.cases import cases

ROOT = Path(__file__).parents[1]


@cases(
    ("options", "message"),
    [
        ("--margin -1", "margin must be finite and at least 0, got -1.0"),
        ("--seed -1", "seed must be an integer of at least 0, got -1"),
        ("--seeds 0 -1", "seed must be an integer of at least 0, got -1"),
        ("--seed 15625000", "seed must be at most 15624999, got 15625000"),
        ("--hidden 64 0", "hidden must be an integer of at least 1, got 0"),
        ("--learning-rate -1", "learning_rate must be finite and more than 0, got -1.0"),
        ("--final-learning-rate -1", "final_learning_rate must be finite and at least 0, got -1.0"),
        ("--gamma 1.1", "gamma must be finite and at least 0 and at most 1, got 1.1"),
        ("--gae-lambda -0.1", "gae_lambda must be finite and at least 0 and at most 1, got -0.1"),
        ("--clip-range 0", "clip_range must be finite and more than 0, got 0.0"),
        ("--rollout 0", "rollout must be an integer of at least 1, got 0"),
        ("--evaluation-episodes 0", "evaluation_episodes must be an integer of at least 1, got 0"),
        ("--settings sac --learning-rate 0", "learning_rate must be finite and more than 0, got 0.0"),
        ("--settings sac --tau 2", "tau must be finite and more than 0 and at most 1, got 2.0"),
    ],
)
def test_what_cannot_be_trained_is_one_line_and_leaves_no_folder(options, message, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["train", "--satellite", "microsat", *options.split()])
    assert exit_code(train.main) == 2
    assert capsys.readouterr().err == f"error: {message}\n"
    assert not list(tmp_path.iterdir())


def test_settings_are_read_from_a_file_as_well(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text('{"algorithm": "sac", "satellite": "cubesat", "steps": 5000}')
    settings = train.TrainingOptions.parse(["--settings", str(path), "--seed", "3"]).training
    assert settings == SACSettings(name="mine", satellite="cubesat", steps=5000, seed=3)
    assert train.named(str(train.CONFIGS / "sac.json")) == train.named("sac")


@cases(
    ("content", "said"),
    [
        (None, "mine.json is missing: give a .json file of training settings, or one of ['ppo',"),
        ("steps = 3", "mine.json is not JSON"),
        ('{"algorithm": "td3"}', "unknown algorithm in mine.json 'td3'; expected one of ['imitation', 'ppo', 'sac']"),
        ('{"algorithm": ["ppo"]}', "unknown algorithm in mine.json ['ppo']"),
        ('{"step": 3}', "mine.json: unknown setting of PPOSettings 'step'"),
        ('{"steps": 0}', "mine.json: steps must be an integer of at least 1, got 0"),
    ],
)
def test_a_file_without_settings_is_refused_in_one_line(content, said, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        Path("mine.json").write_text(content)
    monkeypatch.setattr(sys, "argv", ["train", "--settings", "mine.json"])
    assert exit_code(train.main) == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"error: {said}")
    assert errors.count("\n") == 1
    assert not Path("runs").exists()


@cases(
    ("kind", "setting"),
    [
        (ImitationSettings, {"learning_rate": 0.0}),
        (ImitationSettings, {"hidden": (0,)}),
        (PPOSettings, {"hidden": ()}),
        (SACSettings, {"gamma": -0.1}),
    ],
)
def test_every_algorithm_checks_its_settings(kind, setting):
    with pytest.raises(ValueError, match=next(iter(setting))):
        kind(**setting)


TRACKED = {"tracked": True, "observation": "body", "spares_modes": True, "include_walk": True, "margin": 3.5}


@cases(
    ("learned", "settings"),
    [
        (ppo.learned_policy, PPOSettings(**TRACKED)),
        (sac.learned_policy, SACSettings(**TRACKED)),
    ],
)
def test_a_policy_flies_as_it_was_trained(learned, settings):
    """That of SAC once flew without what spares the modes."""
    hidden, last = torch.nn.Sequential(torch.nn.Linear(4, 5)), torch.nn.Linear(5, 3)
    actor = SimpleNamespace(latent_pi=hidden, mu=last)
    model = SimpleNamespace(
        actor=actor, policy=SimpleNamespace(mlp_extractor=SimpleNamespace(policy_net=hidden), action_net=last)
    )
    policy = learned(model, settings)
    for name in (*TRACKED, "name", "control", "include_covariance", "repeat"):
        if name != "tracked":
            assert getattr(policy, name) == getattr(settings, name), name


def test_what_is_shown_of_many_satellites_has_no_part_in_their_merit(monkeypatch):
    row = dict.fromkeys(SCORES, 0.001)
    few = [{**row, "satellite": str(i), "cost": 0.02 * (i == 0)} for i in range(5)]
    many = [{**row, "satellite": str(i), "cost": 0.02 * (i == 0)} for i in range(20)]
    before = merit(few), merit(many)
    assert before == pytest.approx((2 * 0.001, 0.001))  # one beyond: twice the limit, and no more than one in twenty
    for shown in (1, 100):
        monkeypatch.setattr(run, "_ROWS_SHOWN", shown)
        assert (merit(few), merit(many)) == before


@cases("module", ["agents.training.imitation", "agents.training.combine", "agents.imitate"])
def test_imitation_does_without_stable_baselines3(module):
    text = f"import sys, {module}; sys.exit('stable_baselines3' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", text], cwd=ROOT).returncode == 0


@pytest.mark.slow  # trains
def test_the_times_of_a_training_hold_its_last_evaluation(monkeypatch, tmp_path):
    """One that ends between two evaluations is evaluated once more, which its total once left out."""
    evaluate = Run.evaluate

    def slow(*arguments, **named):
        time.sleep(1.0)
        return evaluate(*arguments, **named)

    monkeypatch.setattr(Run, "evaluate", slow)
    small = {"num_envs": 8, "rollout": 10, "batch_size": 80, "steps": 80, "evaluation_episodes": 1, "hidden": (8,)}
    task = Run(PPOSettings(satellite="microsat", **small), tmp_path / "run", resume=False, module="test")
    ppo.train(task)
    seconds = read_json(tmp_path / "run" / "timing.json", "train again")["seconds"]
    assert seconds["evaluation"] > 2.0
    assert seconds["rollout"] >= 0.0


@pytest.mark.slow  # trains
def test_a_command_that_is_repeated_counts_as_its_decisions(tmp_path, capsys):
    """`steps` are commands; what is reported are decisions."""
    small = {"num_envs": 8, "rollout": 10, "batch_size": 80, "steps": 80, "evaluation_episodes": 1, "hidden": (8,)}
    flown = {"tracked": True, "observation": "body", "switches": True, "repeat": 10}
    task = Run(PPOSettings(satellite="microsat", **small, **flown), tmp_path / "run", resume=False, module="test")
    ppo.train(task)
    assert read_json(tmp_path / "run" / "timing.json", "train again")["decisions"] == 800
    assert task.bar.n == task.bar.total == 800
    assert task.curve[-1]["steps"] == 80
    ppo.train(Run(task.settings, tmp_path / "run", resume=True, module="test"))
    said = capsys.readouterr().out
    assert "800 decisions in " in said
    assert "has had its 800 decisions already" in said
