"""Comparison in pairs: ratios, what is clear, who flies, names that clash, and a stop that is gone on from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from agents.standing.paired_table import paired_table
from baselines.command.cli import UserError
from baselines.scenarios import compare
from baselines.scenarios.compare import Comparison, against
from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.gate import Gate
from satid_gym.evaluation import seeds
from satid_gym.policies.custom import digest
from satid_gym.policies.learned.shipped import RATE_PRETRAINED, find
from satid_gym.policies.reference import ZeroPolicy
from tests.cases import cases

STARGAZER = RATE_PRETRAINED / "stargazer"
SHORT = {"satellites": ("microsat",), "inertias": ("static",), "rivals": ("zero",), "split": "validation"}


def test_ratios_are_of_means_and_clear_by_the_paired_interval():
    episodes = np.linspace(1.0, 2.0, 40)
    lower, other = episodes - 0.1, episodes + 0.3 * (-1.0) ** np.arange(40)
    rows = [{"expected": values.tolist(), "error": values[::-1].tolist()} for values in (lower, episodes, other)]
    assert against(rows[0], rows[1])["expected"] == {"ratio": pytest.approx(1.4 / 1.5), "clear": -1}
    assert against(rows[1], rows[0])["error"] == {"ratio": pytest.approx(1.5 / 1.4), "clear": 1}
    assert against(rows[2], rows[1])["expected"]["clear"] == 0


def test_the_shipped_policy_beats_zero_and_a_second_run_flies_nothing_again(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("baselines.command.provenance.revision", lambda _: "a1")
    path = tmp_path / "found.json"
    settings = Comparison(policies=("stargazer",), episodes=4, output=path, **SHORT)
    settings.check()
    assert compare.main(settings) == 0
    own, zero = json.loads(path.read_text())["rows"]
    assert np.mean(own["expected"]) < 0.25 * np.mean(zero["expected"])
    assert max(own["costs"].values()) <= 0.01
    assert "lower" in capsys.readouterr().out
    cell = Cell(scenario="calibration", satellite="microsat", inertia="static")
    direct = flown(cell, ZeroPolicy(), seeds("validation", 4))
    np.testing.assert_allclose(zero["expected"], direct.expected, rtol=1e-4)

    whole = path.read_text()
    half = json.loads(whole)
    half["rows"].pop()
    path.write_text(json.dumps(half))
    flights = []
    monkeypatch.setattr(compare, "flown", lambda cell, *rest: flights.append(cell) or flown(cell, *rest))
    assert compare.main(settings) == 0
    assert len(flights) == 1
    assert json.loads(path.read_text())["rows"] == json.loads(whole)["rows"]
    other = Comparison(policies=("stargazer",), episodes=3, output=path, **SHORT)
    with pytest.raises(UserError, match="was flown with episodes = 4: give another --output, or --again"):
        compare.main(other)
    assert compare.main(replace(other, again=True)) == 0
    assert len(flights) == 3, "another comparison is flown whole"


def test_the_weights_of_ones_own_policy_are_part_of_what_is_compared(tmp_path):
    for ending in (".json", ".safetensors"):
        (tmp_path / f"mine{ending}").write_bytes(STARGAZER.with_suffix(ending).read_bytes())
    comparison = Comparison(policies=(f"mine={tmp_path / 'mine'}", "lookahead"), **SHORT)
    (found,) = comparison.identities().items()
    assert found == ("mine", digest(find("stargazer")))


def test_each_scenario_has_a_file_of_its_own():
    for settings, kind in (
        (Comparison(policies=("zero",), scenario="slosh"), "pairs"),
        (Gate(scenario="slosh"), "gate"),
    ):
        assert settings.file == Path(f"results/{kind}_slosh.json")
        assert replace(settings, output=Path("x.json")).file == Path("x.json")


def test_the_table_has_a_line_for_each_cell_and_counts_what_is_clear(tmp_path):
    path = tmp_path / "found.json"
    assert compare.main(Comparison(policies=("stargazer",), episodes=4, output=path, **SHORT)) == 0
    results = json.loads(path.read_text())
    table = paired_table(results, "stargazer", ["zero"])
    assert "| microsat static |" in table
    assert "clearly lower in 1 of 1 cells, clearly higher in 0" in table


@cases(
    ("policies", "message"),
    [
        ((f"mpc={STARGAZER}",), "the name 'mpc': give one another, NAME="),
        (("stargazer", f"stargazer={STARGAZER}"), "the name 'stargazer'"),
        (("stargazr",), "'stargazr'"),
    ],
)
def test_names_that_clash_or_are_unknown_are_refused(policies, message):
    with pytest.raises(ValueError, match=message):
        Comparison(policies=policies, rivals=("mpc",)).check()


def test_a_rival_is_judged_with_the_settings_tuned_for_each_satellite():
    comparison = Comparison(policies=("lookahead",), rivals=("swing_and_stop",))
    assert comparison.judged() == ["lookahead"]
    settings, policy = comparison.entrants("cubesat")["lookahead"]
    assert settings["policy"] == policy.policy.name == "stargazer"
    swings = [comparison.entrants(name)["swing_and_stop"][0] for name in ("cubesat", "microsat")]
    assert swings[0] != swings[1]
