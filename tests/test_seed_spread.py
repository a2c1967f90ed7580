"""Spread over seeds: scores of runs that differ in their seed, what is kept, and what is refused."""

import copy
import dataclasses
import json

import numpy as np
import pytest

from agents.standing import seeds as spread
from agents.standing.seeds import Spread, main, seeds_table
from baselines.scenarios.flights import Cell, flown
from satid_gym.evaluation import seeds
from satid_gym.files import read_json
from satid_gym.policies.learned.network import Network
from satid_gym.policies.learned.shipped import find
from tests.cases import cases

SMALL = Spread(
    runs=(), scenario="tight", satellites=("microsat",), inertias=("static", "drift"), episodes=2, split="validation"
)


@pytest.fixture
def runs(tmp_path):
    """The shipped tour, and what another seed might have found."""
    shipped = find("rigid_tour")
    other = copy.copy(shipped)
    (weights,), biases = shipped.network.weights, shipped.network.biases
    shift = np.random.default_rng(0).normal(0.0, 0.3, weights.shape).astype(np.float32)
    other.network = Network((weights + shift,), biases)
    training = shipped.details["training"]
    other.details = {"training": {**training, "seconds": 90.0, "settings": {**training["settings"], "seed": 1}}}
    for policy, name in ((shipped, "rigid_tour-0"), (other, "rigid_tour-1")):
        (tmp_path / name).mkdir()
        policy.save(tmp_path / name / "policy")
    return tmp_path / "rigid_tour-0", tmp_path / "rigid_tour-1"


def test_scores_are_those_of_each_seeds_flights(runs, tmp_path, capsys):
    output = tmp_path / "seeds.json"
    assert main(dataclasses.replace(SMALL, runs=tuple(map(str, runs)), output=output)) == 0
    (training,) = read_json(output, "")["trainings"]
    assert (training["policy"], training["scenario"], training["split"]) == ("rigid_tour", "tight", "validation")
    expected = []
    for own, run in zip(training["runs"], runs, strict=True):
        cells = [Cell(scenario="tight", satellite="microsat", inertia=law) for law in SMALL.inertias]
        flights = [flown(cell, find(run), seeds("validation", 2)) for cell in cells]
        expected.append(np.exp(np.mean([np.log(flight.expected.mean()) for flight in flights])))
        assert own["expected"] == pytest.approx(expected[-1], rel=1e-4)
        assert own["cost"] == pytest.approx(max(flight.costs.mean(axis=0).max() for flight in flights), rel=1e-4)
    assert [own["seed"] for own in training["runs"]] == [0, 1]
    assert [own["shipped"] for own in training["runs"]] == [True, False]
    said = capsys.readouterr().out
    ratio = 100.0 * np.std(expected, ddof=1) / np.mean(expected)
    assert f"| **{100 * expected[0]:.3g}**, {100 * expected[1]:.3g} | {ratio:.1f} |" in said
    assert "| 2 |" in said, "minutes of the seed that says how long it took"


def test_other_trainings_stay_in_the_file_and_the_same_is_replaced(runs, tmp_path, monkeypatch):
    output = tmp_path / "seeds.json"
    one = dataclasses.replace(SMALL, runs=("rigid_tour",), inertias=("static",), output=output)
    assert main(one) == 0
    monkeypatch.setattr(spread, "fly", lambda tasks, folder, again: [task.kept(folder) for task in tasks])
    assert main(one) == 0, "flies nothing again"
    kept = json.loads(output.read_text())["trainings"]
    assert len(kept) == 1
    assert kept[0]["runs"][0]["shipped"]
    output.write_text(json.dumps({"trainings": [{**kept[0], "policy": "another"}]}))
    assert main(one) == 0
    assert [own["policy"] for own in json.loads(output.read_text())["trainings"]] == ["another", "rigid_tour"]
    assert seeds_table({"trainings": kept}).count("| - |") == 2, "of one seed no spread, of an older run no time"


@cases(
    ("runs", "message"),
    [
        (("rigid_tour", "panel_tour"), "panel_tour was trained with other .*scenario.* than rigid_tour: name runs"),
        (("clear_tour",), "clear_tour does not fly in tight: .*band"),
        (("none",), "no such file"),
        (("rigid_tour", "rate/rigid_tour"), "runs must have different names, got rigid_tour for 2 runs"),
        ((), "name at least one run"),
    ],
)
def test_runs_that_are_not_of_one_training_are_refused(runs, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(SMALL, runs=runs).check()
