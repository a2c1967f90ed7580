"""Examples of trainers that need no other library: seeds of their environments, and their scores."""

from __future__ import annotations

import importlib
import re
import runpy
from pathlib import Path

import pytest
import torch

from satid_gym import SatInertiaIDVectorEnv
from satid_gym.evaluation import FIRST_SEED, SPLIT_SIZE, fly, seeds
from satid_gym.policies import find
from tests.cases import cases

FOLDER = Path(__file__).parents[1] / "examples" / "trainers"


@pytest.fixture
def trainer(monkeypatch):
    """Imports a trainer by name."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module


@cases("name", ["ppo_sb3", "ppo_one_file", "lagrangian_ppo"])
def test_trainings_with_different_seeds_share_no_episode(name, trainer, monkeypatch):
    """Seeds 0 and 1 once had all but one of their environments in common."""
    module, begun, reset = trainer(name), [], SatInertiaIDVectorEnv.reset

    def noted(env, **named):
        result = reset(env, **named)
        begun.append(env.np_random_seed)
        return result

    monkeypatch.setattr(SatInertiaIDVectorEnv, "reset", noted)
    monkeypatch.setattr(module, "updates", lambda steps: 0, raising=False)
    for seed in range(3):
        module.train(0, seed)
    assert [len(own) for own in begun] == [64] * 3
    assert len({seed for own in begun for seed in own}) == 3 * 64
    assert all(0 <= seed - FIRST_SEED["training"] < SPLIT_SIZE for own in begun for seed in own)


def test_the_final_error_is_that_of_the_protocol(trainer):
    """The paper's window, of 60 decisions in 300; it had 61 once."""
    module = trainer("lagrangian_ppo")

    class Still:
        name, kind, observation = "still", "reference", "body"

        def reset(self, mission, seeds):
            pass

        def __call__(self, observation):
            return 0.0 * observation[:, :3]

    found = module.scores(lambda observation: torch.zeros(len(observation), 3), episodes=2)
    own = {"satellite": "microsat", "inertia": "static", "scenario": "flex", "control": "rate"}
    flown = fly(Still(), seeds=seeds("validation", 2), **own).scores()
    assert found["final_error"] == pytest.approx(flown["final_error"].mean(), rel=1e-12)
    assert found["ended"] == 0.0


@pytest.mark.slow  # trains
def test_a_constrained_policy_of_any_scenario_is_saved_as_commands_take_it(trainer, monkeypatch, tmp_path, capsys):
    """The world was fixed, and what was learned was lost with the process."""
    words = ["--scenario", "slosh", "--satellite", "cubesat", "--limits", "deflection=0.02", "keep_out=0.01"]
    monkeypatch.setattr("sys.argv", ["lagrangian_ppo", "--steps", "3200", *words, "--save", str(tmp_path / "mine")])
    trainer("excitation")  # finds the folder
    runpy.run_path(str(FOLDER / "lagrangian_ppo.py"), run_name="__main__")
    said = capsys.readouterr().out
    policy = find(str(tmp_path / "mine-0"))
    assert policy.details["trained"]["limits"] == {"deflection": 0.02, "keep_out": 0.01}
    world = policy.details["trained"]["world"]
    assert (world["scenario"], world["satellite"], world["inertia"]) == ("slosh", "cubesat", "static")
    own = {name: world[name] for name in ("scenario", "satellite", "inertia", "control")}
    flown = fly(policy, seeds=seeds("validation", 64), **own).scores()["final_error"].mean()
    printed = float(re.search(r"final_error (\S+) %", said)[1]) / 100.0
    assert flown == pytest.approx(printed, rel=0.1)  # the rate loop's margin and `SHARE` are not quite the same
