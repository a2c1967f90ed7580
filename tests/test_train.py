"""Training: a stopped run goes on with the same result; bad settings are refused before anything starts."""

import importlib
import itertools
import json
import shutil
import sys

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents.training import ppo, select
from agents.training.ppo import PPOSettings
from agents.training.run import Run, merit, summary, validate
from agents.training.sb3.loop import Training, environment
from agents.training.settings import policy_of
from agents.training.train import main, named
from baselines import tuned_entry
from baselines.command.cli import exit_code
from satid_gym import RewardSettings
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.profiles import PROFILES

pytestmark = pytest.mark.slow  # trains

SMALL = {
    "satellite": "microsat",
    "num_envs": 16,
    "rollout": 10,
    "batch_size": 80,
    "epochs": 2,
    "hold": 4,
    "evaluate_every": 160,
    "evaluation_episodes": 2,
    "hidden": (8,),
}


def run(folder, steps, *, resume=False):
    # the schedule of the learning rate belongs to the whole run, so a stop is made by raising after an update
    settings = PPOSettings.from_dict({**SMALL, "steps": 640})
    task = Run(settings, folder, resume=resume, module="test")
    if steps < 640:
        save = Training.save

        def stop(training):
            save(training)
            if training.model.num_timesteps >= steps:
                raise KeyboardInterrupt

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Training, "save", stop)
            with pytest.raises(KeyboardInterrupt):
                ppo.train(task)
        return None
    return {k: v.clone() for k, v in ppo.train(task).policy.state_dict().items()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run that went to its end: its folder and its network."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    return folder, run(folder, 640)


@pytest.mark.parametrize("module", ["train --settings ppo", "imitate"])
def test_the_wheels_speed_limit_is_not_lowered_twice(module, tmp_path, monkeypatch, capsys):
    """Scenario "tight" lowers it to a tenth, and so does a factor of the training settings."""
    name, *options = module.split()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, *options, "--scenario", "tight"])
    assert exit_code(importlib.import_module(f"agents.{name}").main) == 2
    said = capsys.readouterr().err
    assert "multiplies the wheels' speed limit by 0.1 already" in said
    assert "it would be 0.1, 0.01 of nominal; add --wheel-scales 1" in said
    assert not list(tmp_path.iterdir())


def test_a_scenario_with_slow_wheels_is_trained_in_by_itself():
    settings = PPOSettings(scenario="tight", wheel_scales=(1.0,))
    (nominal,) = {s.wheels.max_speed[0] for s in settings.pool() if s.name == "microsat"}
    assert nominal == 900.0  # the scenario makes it 90


def test_training_starts_staggered():
    env = environment(PPOSettings.from_dict(SMALL))
    env.reset()
    ends = [env.step(np.zeros((16, 3), np.float32))[2].sum() for _ in range(300)]
    assert max(ends) == 1
    assert sum(ends) == 16
    env.close()


@pytest.fixture
def copy(finished, tmp_path):
    return shutil.copytree(finished[0], tmp_path / "copy")


def test_a_stopped_run_resumes_with_the_same_result(finished, tmp_path):
    folder, whole = finished
    run(tmp_path / "stopped", 320)
    resumed = run(tmp_path / "stopped", 640, resume=True)
    for name, tensor in whole.items():
        assert torch.equal(tensor, resumed[name]), name
    curves = [(f / "curve.csv").read_text().splitlines() for f in (folder, tmp_path / "stopped")]
    without_seconds = [[line.split(",")[:1] + line.split(",")[2:] for line in c] for c in curves]
    assert without_seconds[0] == without_seconds[1]
    assert [line.split(",")[0] for line in curves[0]] == ["steps", "0", "160", "320", "480", "640"]


def test_the_run_folder_tells_how_it_came_about(copy):
    head = json.loads((copy / "run.json").read_text())
    assert PPOSettings.from_dict(head["settings"]) == PPOSettings.from_dict({**SMALL, "steps": 640})
    assert head["command"].startswith("python -m test")
    assert "torch" in head["versions"]
    policy = LearnedPolicy.load(copy / "policy")
    assert policy.details["trained"]["settings"]["hidden"] == [8]
    timing = json.loads((copy / "timing.json").read_text())
    parts = ("environment", "update", "evaluation", "rollout")
    assert sum(timing["seconds"][p] for p in parts) == pytest.approx(timing["seconds"]["total"])


def test_a_folder_in_use_and_a_folder_without_a_run_are_refused(copy, tmp_path):
    with pytest.raises(ValueError, match="add --resume"):
        run(copy, 640)
    with pytest.raises(ValueError, match="holds no run"):
        run(tmp_path / "none", 640, resume=True)


@pytest.mark.parametrize("damage", ["cut", "flipped"])
@pytest.mark.parametrize("at", [0, 100, 5000, -1])
def test_a_damaged_checkpoint_is_put_aside_for_the_one_before(copy, finished, at, damage, capsys):
    path = copy / "checkpoint.npz"
    content = bytearray(path.read_bytes())
    if damage == "cut":
        del content[at:]
    else:
        content[at] ^= 1
    path.write_bytes(content)
    resumed = run(copy, 640, resume=True)
    assert all(torch.equal(tensor, resumed[name]) for name, tensor in finished[1].items())
    assert "going on from the checkpoint before it" in capsys.readouterr().err
    assert (copy / "checkpoint.damaged.npz").read_bytes() == content


def test_two_damaged_checkpoints_are_refused(copy):
    for name in ("checkpoint.npz", "checkpoint.previous.npz"):
        (copy / name).write_bytes((copy / name).read_bytes()[:5000])
    with pytest.raises(ValueError, match="not a whole checkpoint"):
        run(copy, 640, resume=True)


def test_settings_are_checked():
    with pytest.raises(ValueError, match="batch_size must divide"):
        PPOSettings(batch_size=7)
    with pytest.raises(ValueError, match="unknown satellite 'cube'"):
        PPOSettings(satellite="cube")
    with pytest.raises(ValueError, match=r"unknown setting of PPOSettings 'step'.*'steps'"):
        PPOSettings.from_dict({"step": 1})
    with pytest.raises(ValueError, match="unknown training settings"):
        named("nothing")
    assert named("ppo").wheel_scales == (1.0, 0.1)


@pytest.mark.parametrize("arguments", [["--satellite", "moon"], ["--resume"], ["--settings", "none"]])
def test_the_command_line_ends_with_one_line(arguments, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["train", *arguments])
    assert exit_code(main) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("error: ")
    assert errors.count("\n") == 1


def test_better_policies_have_lower_merit():
    row = {"final_error": 0.002, "mean_error": 0.004, "cost": 0.005}
    assert merit([row]) == pytest.approx(np.sqrt(0.002 * 0.004))
    assert merit([{**row, "cost": 0.03}]) == pytest.approx(3 * merit([row]))


def test_a_policy_that_misses_imaging_windows_is_the_worse_for_it():
    """It once counted as within all limits: no rate was outside its own and no wheel saturated."""
    settings = PPOSettings(scenario="operations", satellite="microsat")
    size = environment(settings).observation_space.shape[0]
    still = Network((np.zeros((3, size), np.float32),), (np.zeros(3, np.float32),))
    (row,) = validate(policy_of(still, settings), settings, 2)
    assert row["outside_fraction"] == row["saturated_fraction"] == 0.0
    assert row["cost"] > 0.1
    assert merit([row]) == pytest.approx(row["cost"] / 0.01 * np.sqrt(row["final_error"] * row["mean_error"]))
    assert f" {100 * row['cost']:.3f}" in summary([row])


def test_every_validation_is_in_tensorboard_at_its_own_step(finished):
    """A run with fewer than ten updates once left a file without a number."""
    events = EventAccumulator(str(finished[0] / "tensorboard"))
    events.Reload()
    for name in ("final_error", "cost"):
        assert [event.step for event in events.Scalars(f"validation_microsat/{name}")] == [0, 160, 320, 480, 640]


def test_a_run_says_after_how_many_decisions_the_kept_policy_was(tmp_path, monkeypatch, capsys):
    for name, sign, decisions in (("better", -1, 640), ("worse", 1, 0)):
        steps = itertools.count()
        monkeypatch.setattr("agents.training.run.merit", lambda *_, sign=sign, steps=steps: sign * next(steps))
        run(tmp_path / name, 640)
        said = capsys.readouterr()
        assert f"policy with the best validation score, after {decisions} decisions: {tmp_path / name}" in said.out
        assert ("warning: that is the network from before training" in said.err) == (decisions == 0)


def test_the_choice_flies_every_run_and_ships_the_better_one(copy, finished, tmp_path, monkeypatch, capsys):
    """One of the two commands full rate back and forth at random: it knows more than one that hardly moves."""
    lively, shipped = LearnedPolicy.load(copy / "policy"), tmp_path / "pretrained"
    network = lively.network
    for weight in network.weights:
        weight *= 30.0
    lively.save(copy / "policy")
    shipped.mkdir()
    monkeypatch.setattr(select, "PRETRAINED", shipped)
    arguments = ["choose", str(finished[0]), str(copy), "--ship", "--margin", "3.1", "--episodes", "6"]
    monkeypatch.setattr("sys.argv", arguments)
    assert exit_code(select.main) == 0
    assert f"best by final and mean error: {copy}" in capsys.readouterr().out
    policy = LearnedPolicy.load(shipped / lively.name)
    assert policy.margin == 3.1
    assert policy.details["validation_episodes"] == 6
    head = json.loads((copy / "run.json").read_text())
    assert all(policy.details["trained"][name] == head[name] for name in ("command", "revision", "versions"))
    expected = validate(policy, PPOSettings.from_dict(policy.details["trained"]["settings"]), 6)
    assert policy.details["validation"] == expected


@pytest.mark.parametrize(("option", "message"), [(("--episodes", "0"), "episodes"), (("--margin", "-1"), "margin")])
def test_a_choice_that_cannot_be_made_ends_with_one_line(copy, monkeypatch, capsys, option, message):
    monkeypatch.setattr("sys.argv", ["choose", str(copy), *option])
    assert exit_code(select.main) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    "details", [{}, {"trained": "by hand"}, {"trained": {"settings": []}}, {"trained": {"settings": {"step": 1}}}]
)
def test_a_policy_that_does_not_say_how_it_was_trained_is_not_chosen(copy, monkeypatch, capsys, details):
    policy = LearnedPolicy.load(copy / "policy")
    policy.details = details
    policy.save(copy / "policy")
    monkeypatch.setattr("sys.argv", ["choose", str(copy)])
    assert exit_code(select.main) == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"error: policy {policy.name} does not say how it was trained (")
    assert errors.count("\n") == 1


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"satellite": "cubesat"}, "satellites"),
        ({"inertia": "static"}, "inertia"),
        ({"scenario": "tight"}, "scenario"),
        ({"tracked": True}, "actions"),
        ({"judged_by": "reward"}, "judged_by"),
        ({"inertia": "static", "judged_by": "reward"}, "inertia, judged_by"),
    ],
)
def test_runs_of_different_worlds_are_not_compared(copy, finished, monkeypatch, capsys, changes, named):
    policy = LearnedPolicy.load(copy / "policy")
    policy.details["trained"]["settings"] |= changes
    policy.save(copy / "policy")
    monkeypatch.setattr("sys.argv", ["choose", str(finished[0]), str(copy)])
    assert exit_code(select.main) == 2
    said = f"error: {copy} was trained with other {named} than {finished[0]}: choose among runs of one setting\n"
    assert capsys.readouterr().err == said


def test_drawn_satellites_of_other_wheels_are_other_satellites(tmp_path):
    runs = [PPOSettings(satellite="drawn", drawn=2, drawn_wheels=wheels) for wheels in (4, 5)]
    select.check_same([tmp_path], runs[:1])
    with pytest.raises(ValueError, match="other satellites"):
        select.check_same([tmp_path, tmp_path], runs)


def test_an_error_of_flight_is_not_taken_for_one_of_training(copy, monkeypatch):
    def flight(*_):
        raise ValueError("of flight")

    monkeypatch.setattr(select, "validate", flight)
    monkeypatch.setattr("sys.argv", ["choose", str(copy)])
    with pytest.raises(ValueError, match=r"^of flight$"):
        exit_code(select.main)


@pytest.mark.parametrize("control", ["rate", "torque"])
def test_a_short_training_with_the_default_settings_ends_below_every_scripted_profile(control, tmp_path):
    """Half of the README's short training: it ended above doing nothing once."""
    settings = PPOSettings(satellite="microsat", control=control, steps=100_000, evaluate_every=100_000)
    task = Run(settings, tmp_path / "short", resume=False, module="test")
    ppo.train(task)
    before, after = task.curve[0]["final_error"], min(row["final_error"] for row in task.curve[1:])
    scripted = [tuned_entry(name, "microsat")["final_error"] for name in PROFILES]
    assert after < min(scripted)
    assert after < 0.5 * before


def test_the_rewards_zero_is_the_one_difference_of_training_from_the_default_reward():
    assert PPOSettings().reward.replace(held_reference=0.0).to_dict() == RewardSettings().to_dict()
