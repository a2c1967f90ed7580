"""Soft Actor-Critic through the same run as PPO: it resumes exactly, and its policy flies like any other."""

import json
import sys

import numpy as np
import pytest
import torch

from agents.benchmark import evaluate
from agents.training import sac, train
from agents.training.run import Run
from agents.training.sac import SACSettings
from agents.training.sb3.loop import Training
from agents.training.train import named, resumed
from baselines.command.cli import exit_code
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.shipped import find

pytestmark = pytest.mark.slow  # trains
SMALL = SACSettings(
    satellite="microsat",
    num_envs=8,
    rollout=5,
    batch_size=64,
    gradient_steps=2,
    warmup=80,
    buffer=240,  # is full before the end
    steps=480,
    evaluate_every=120,
    evaluation_episodes=2,
    hidden=(16, 8),
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run that went to its end: its folder and its model."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    return folder, sac.train(Run(SMALL, folder, resume=False, module="agents.train"))


def test_a_stopped_run_resumes_with_the_same_networks_and_replay_buffer(finished, tmp_path, monkeypatch, capsys):
    run = Run(SMALL, tmp_path / "stopped", resume=False, module="agents.train")
    save = Training.save

    def stop(training):
        save(training)
        if training.model.num_timesteps >= 240:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Training, "save", stop)
        with pytest.raises(KeyboardInterrupt):
            sac.train(run)
    assert not (run.folder / "timing.json").exists()
    monkeypatch.setattr(sys, "argv", ["train", "--run", str(run.folder), "--resume"])
    assert exit_code(train.main) == 0  # which algorithm, is in the folder
    with np.load(finished[0] / "checkpoint.npz") as one, np.load(run.folder / "checkpoint.npz") as other:
        arrays = sorted(set(one.files) - {"head"})
        assert {name.partition("/")[0] for name in arrays} >= {
            "policy", "actor.optimizer", "critic.optimizer", "ent_coef_optimizer", "variable", "replay"
        }  # fmt: skip
        for name in arrays:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    for name in ("policy.safetensors", "last.safetensors"):
        assert (run.folder / name).read_bytes() == (finished[0] / name).read_bytes()


def test_the_policy_is_the_models_mean_action(finished):
    folder, model = finished
    policy = LearnedPolicy.load(folder / "last")
    observations = np.random.default_rng(0).uniform(-3, 3, (20, 70)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.network(observations), expected, atol=1e-5)
    assert policy.details["trained"]["method"] == "sac"
    assert SACSettings.from_dict(policy.details["trained"]["settings"]) == SMALL


def test_the_policy_is_evaluated_like_any_other(finished, monkeypatch, capsys):
    line = ["evaluate", str(finished[0] / "policy"), "--satellites", "microsat", "--modes", "step", "--episodes", "2"]
    monkeypatch.setattr(sys, "argv", line)
    assert exit_code(evaluate.main) == 0
    assert "microsat: final error" in capsys.readouterr().out
    assert find(str(finished[0])).network.activation == "relu"


def test_the_settings_choose_the_algorithm(finished):
    assert type(named("sac")) is SACSettings
    assert resumed(finished[0]) == SMALL
    assert json.loads((finished[0] / "run.json").read_text())["algorithm"] == "sac"


def test_a_checkpoint_of_other_networks_is_refused(finished, tmp_path, capsys):
    folder, _ = finished
    wide = Run(SMALL.replace(hidden=(32,)), tmp_path / "wide", resume=False, module="agents.train")
    (wide.folder / "checkpoint.npz").write_bytes((folder / "checkpoint.npz").read_bytes())
    with pytest.raises(ValueError, match="is of other settings"):
        sac.train(wide)


def test_a_short_training_lowers_the_errors(tmp_path):
    settings = SACSettings(satellite="microsat", steps=24_000, evaluate_every=24_000)
    run = Run(settings, tmp_path / "short", resume=False, module="agents.train")
    sac.train(run)
    first, last = run.curve[0], run.curve[-1]
    assert last["final_error"] < 0.3 * first["final_error"]
    assert torch.get_num_threads() == 1
