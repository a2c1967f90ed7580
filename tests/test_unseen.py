"""Comparison on unseen satellites: ratios by hand, and the command."""

from __future__ import annotations

import dataclasses
import json
import sys

import numpy as np
import pytest

from agents.unseen import compare, flights
from baselines.command import cli
from satid_gym.drawn_satellite import draw_satellites
from satid_gym.policies.custom import digest
from satid_gym.policies.learned.shipped import find
from satid_gym.scenario_catalogue import SCENARIOS


def _row(satellite, policy, errors, outside, inertia="step"):
    scores = {"mean_error": errors, "final_error": errors, "nees": errors, **dict.fromkeys(flights.LIMITS, outside)}
    scores["terminated"] = [0.0] * len(errors)
    return {"satellite": satellite, "wheels": 4, "inertia": inertia, "policy": policy, **scores}


ROWS = [
    _row("a", "one", [1.0, 3.0], [0.0, 0.01]),
    _row("a", "two", [2.0], [0.0]),
    _row("b", "one", [1.0, 5.0], [0.0, 0.05]),
    _row("b", "two", [4.0], [0.02]),
    _row("b", "one", [4.0, 5.0], [0.0, 0.0], "drift"),
    _row("b", "two", [4.0], [0.0], "drift"),
    _row("c", "one", [7.0], [0.0]),
]


def test_ratios_are_of_the_episodes_that_both_have_flown():
    np.testing.assert_allclose(flights.ratios(ROWS, "one", "two"), [0.5, 0.5])  # b: sqrt(1/4 * 4/4)
    np.testing.assert_allclose(flights.ratios(ROWS, "two", "one"), [2.0, 2.0])


def test_a_satellite_counts_as_inside_by_its_mean_over_laws():
    # "one": a 0.5 %, b (2.5 % + 0) / 2 = 1.25 %, c 0; "two": a 0, b (2 % + 0) / 2 = 1 %
    assert flights.inside(ROWS, "one", "cost") == pytest.approx(2.0 / 3.0)
    assert flights.inside(ROWS, "two", "cost") == 1.0


def test_tuned_settings_and_weights_tell_policies_apart(tmp_path):
    tuned = tmp_path / "tuned.json"
    tuned.write_text(json.dumps({"settings": {}, "chosen": {"rate_square": {"period": 12.0, "margin": 3.5}}}))
    settings = compare.Unseen(policies=("rate_square", "rigid_tour"), tuned=tuned)
    assert settings.identities() == {
        "rate_square": {"period": 12.0, "margin": 3.5},
        "rigid_tour": digest(find("rigid_tour")),
    }
    with pytest.raises(ValueError, match=r"tuned in scenario default: give --tuned .* --scenario flex"):
        dataclasses.replace(settings, scenario="flex").entrants()
    with pytest.raises(ValueError, match="baseline 'corner_tour' was not tuned on drawn satellites, only rate_square"):
        dataclasses.replace(settings, policies=("corner_tour",)).entrants()


def test_panels_are_unseen_too():
    own, tuned, unseen = (
        SCENARIOS["flex"].appendages,
        *(flights.world_of("flex", split).appendages for split in ("tuning", "test")),
    )
    (satellite,) = draw_satellites([11], wheels=4)
    assert tuned == own
    assert not set(own.equip(satellite)) & set(unseen.equip(satellite))
    assert flights.world_of("default", "test") == flights.world_of("default", "tuning")


@pytest.mark.slow
def test_the_command_flies_shows_and_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("baselines.command.provenance.revision", lambda _: "a1")
    tuned, output = tmp_path / "tuned.json", tmp_path / "unseen.json"
    chosen = {"rate_square": {"period": 12.0, "margin": 3.5, "slews": 3.0}}
    tuned.write_text(json.dumps({"settings": {}, "chosen": chosen}))
    arguments = ["--policies", "rate_square", "--episodes", "1", "--split", "validation"]
    monkeypatch.setattr(
        sys, "argv", ["compare", *arguments, "--satellites", "1", "--tuned", str(tuned), "--output", str(output)]
    )
    assert cli.exit_code(compare.main) == 0
    assert "rate_square" in capsys.readouterr().out
    held = json.loads(output.read_text())
    assert len(held["rows"]) == 4
    assert held["summary"][0]["rate_square_over_it_mean_error"]["median"] == 1.0
    held["rows"][0]["mean_error"] = [1.0]
    output.write_text(json.dumps(held))
    assert cli.exit_code(compare.main) == 0  # nothing is flown again
    assert json.loads(output.read_text())["rows"][0]["mean_error"] == [1.0]
    tuned.write_text(json.dumps({"settings": {}, "chosen": {"rate_square": {**chosen["rate_square"], "period": 13.0}}}))
    assert cli.exit_code(compare.main) == 2
    assert "was flown with other identities: give another --output, or --again" in capsys.readouterr().err
