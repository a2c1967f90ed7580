"""Minari data sets: what is in them is what was flown, and learning takes them as they are."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

minari = pytest.importorskip("minari")
pytestmark = pytest.mark.reach

from agents.dataset import collection, storage
from agents.dataset.flights import record
from agents.training import imitation
from baselines.command.cli import exit_code
from satid_gym import SATELLITES
from satid_gym.evaluation import FIRST_SEED, SPLIT_SIZE, fly, seeds
from satid_gym.gym_api import COSTS
from satid_gym.policies import find, make_baseline
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases

SHORT = SCENARIOS["default"].replace(name="short", horizon=20.0)
COLLECT = "--satellites cubesat microsat --modes static step --episodes 2"


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    monkeypatch.chdir(tmp_path)


def command(monkeypatch, module, line):
    monkeypatch.setattr(sys, "argv", ["command", *line.split()])
    return exit_code(module.main)


def example(name):
    return runpy.run_path(str(Path(__file__).parents[1] / "examples" / name), run_name="__main__")


def replayed(data):
    """Whether each episode's actions, flown again from its seed and options, give what the file has."""
    env = data.recover_environment()
    same = []
    for told, episode in zip(data.storage.get_episode_metadata(range(len(data))), data.iterate_episodes(), strict=True):
        observation, info = env.reset(seed=told["seed"], options=told["options"])
        steps = [(observation, 0.0, False, False, info), *map(env.step, episode.actions)]
        observations, rewards, terminations, truncations, infos = zip(*steps, strict=True)
        np.testing.assert_array_equal(observations, episode.observations)
        np.testing.assert_array_equal(rewards[1:], episode.rewards)
        np.testing.assert_array_equal(terminations[1:], episode.terminations)
        np.testing.assert_array_equal(truncations[1:], episode.truncations)
        for name in COSTS:
            np.testing.assert_array_equal([info["costs"][name] for info in infos], episode.infos["costs"][name])
        for name in ("inertia_true", "inertia_estimate", "relative_error", "torque_applied"):
            np.testing.assert_array_equal([info[name] for info in infos], episode.infos[name])
        same.append((bool(terminations[-1]), bool(truncations[-1])))
    return same


@cases("control", ["torque", "rate"])
def test_flights_are_in_the_file_and_can_be_flown_again(control, monkeypatch):
    assert command(monkeypatch, collection, f"{COLLECT} --policies chirp generalist mpc --control {control}") == 0
    for policy in ("chirp", "generalist", "mpc"):
        data, head = storage.load(f"satid/{policy}-v0")
        assert replayed(data) == [(False, True)] * 8
        told = list(data.storage.get_episode_metadata(range(8)))
        assert [episode["seed"] for episode in told] == list(range(8)), "of the training split, the same for everybody"
        assert head["seeds"] == {"split": "training", "first": 0, "count": 8}
        assert {(str(e["options"]["satellite"]), str(e["options"]["inertia"])) for e in told} == {
            (satellite, mode) for satellite in ("cubesat", "microsat") for mode in ("static", "step")
        }
        assert head["policy"]["name"] == data.storage.metadata["algorithm_name"] == policy
        assert head["environment"]["scenario"] == "default"
        assert head["environment"]["control"] == control
        assert head["revision"]
        minari.delete_dataset(f"satid/{policy}-v0")


def test_an_episode_that_ends_early_ends_in_the_file(monkeypatch):
    """Random torque turns bodies beyond three times their limit."""
    assert command(monkeypatch, collection, "--policies random --satellites cubesat --modes static --episodes 4") == 0
    data, _ = storage.load("satid/random-v0")
    assert replayed(data) == [(True, False)] * 4
    assert data.total_steps < 4 * 300


def test_a_policy_does_as_it_does_in_the_protocol():
    """One that is not shown the covariance that is recorded, and one that asks for it."""
    for policy in (make_baseline("mpc", "microsat"), find("generalist")):
        cell = {"satellite": SATELLITES["microsat"], "inertia": "step", "scenario": SHORT, "control": "torque"}
        episodes = record(policy, seeds=seeds("training", 3), include_covariance=True, **cell)
        flight = fly(policy, seeds=seeds("training", 3), **cell)
        for i, episode in enumerate(episodes):
            np.testing.assert_array_equal(episode.infos["relative_error"][1:], flight.error[:, i])
            np.testing.assert_array_equal(episode.rewards, flight.reward[:, i])
            assert episode.observations.shape == (21, 70)


def test_nothing_is_left_of_a_data_set_that_is_interrupted(monkeypatch, tmp_path, capsys):
    flown = collection.record

    def interrupted(*arguments, **named):
        if named["inertia"] == "step":
            raise KeyboardInterrupt
        return flown(*arguments, **named)

    monkeypatch.setattr(collection, "record", interrupted)
    assert command(monkeypatch, collection, f"{COLLECT} --policies chirp") == 130
    assert not (tmp_path / "minari" / "satid" / "chirp-v0").exists()
    monkeypatch.setattr(collection, "record", flown)
    assert command(monkeypatch, collection, f"{COLLECT} --policies chirp") == 0
    assert command(monkeypatch, collection, f"{COLLECT} --policies chirp") == 2
    assert "holds a data set already" in capsys.readouterr().err


def test_seeds_that_are_passed_over(monkeypatch):
    options = "--policies zero --satellites cubesat --modes static --episodes 2 --skip 500"
    assert command(monkeypatch, collection, options) == 0
    data, _ = storage.load("satid/zero-v0")
    told = [episode["seed"] for episode in data.storage.get_episode_metadata(range(2))]
    assert told == [500, 501]
    assert max(told) < FIRST_SEED["training"] + SPLIT_SIZE


CLONE = "--name mine --hidden 32 --epochs 40 --batch-size 128 --evaluation-episodes 2"


def test_imitation_learns_from_data_sets(monkeypatch, tmp_path):
    """What a policy did in two of its data sets; the new one flies in the same environments."""
    for namespace, skip in (("one", 0), ("two", 8)):
        options = f"{COLLECT} --policies generalist --control rate --namespace {namespace} --skip {skip}"
        assert command(monkeypatch, collection, options) == 0
    names = ("one/generalist-v0", "two/generalist-v0")
    assert command(monkeypatch, imitation, f"{CLONE} --data {' '.join(names)}") == 0
    policy = find(str(tmp_path / "runs" / "mine-0"))
    assert policy.details["trained"]["decisions"] == 2 * 8 * 300
    for observations, actions in map(storage.commands, names):
        sides = np.sign(policy.network(observations))
        assert (sides == np.sign(actions)).mean() > 0.7


@cases(
    ("written", "said"),
    [
        ("--control torque", "imitation learns from flights with control='rate', .* have 'torque'"),
        ("--control rate --no-include-covariance", "with include_covariance=True, .* have False"),
        ("--control rate --namespace other", "satid/rate_square-v0 not found .*python -m agents.dataset writes"),
    ],
)
def test_other_data_sets_are_refused(written, said, monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    options = "--policies rate_square --satellites cubesat --modes static --episodes 1"
    assert command(monkeypatch, collection, f"{options} {written}") == 0
    assert command(monkeypatch, imitation, f"{CLONE} --run {tmp_path / 'run'} --data satid/rate_square-v0") == 2
    assert re.search(said, capsys.readouterr().err)


def test_a_clone_flies_nearly_as_well(monkeypatch):
    """The example with less data; its docs have the figures of all of it."""
    monkeypatch.setattr(sys, "argv", ["06_offline_data.py", "4", "20"])
    errors = example("06_offline_data.py")["errors"]
    assert errors["clone"] < 6.0 * errors["generalist"], "rates of zero have twenty times its error"
