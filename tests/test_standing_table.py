"""The standing table: what is flown again and what is kept, the ladder, and the page in a real browser."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.docs.world_tables import ladders_table
from agents.standing import summary
from agents.standing import table as standing
from agents.standing.lookahead_table import lookahead_table
from agents.standing.replay import pair, replay
from agents.standing.summary import ladder, row
from agents.standing.tasks import BOUND, ORACLE, Episodes, misfit, tasks_of
from baselines.command.cli import exit_code
from baselines.scenarios import tune
from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.rivals import rivals
from satid_gym.evaluation import seeds
from satid_gym.policies.learned.shipped import RATE_PRETRAINED, find
from satid_gym.policy import only_mission
from satid_gym.satellite import SATELLITES
from satid_gym.vector import SatInertiaIDVectorEnv

CELL = Cell(scenario="tight", satellite="microsat", inertia="static")
FEW = Episodes(split="validation", count=2, oracle=0, cost=0.01)


def named(cell, name, episodes=FEW, learned=()):
    (found,) = [task for task in tasks_of(cell, episodes, learned) if task.name == name]
    return found


def run(monkeypatch, module, line):
    monkeypatch.setattr(sys, "argv", [module.__name__, *line.split()])
    return exit_code(module.main)


# tasks


def test_the_make_target_tunes_what_lacks_settings_and_flies_the_table():
    recipe = re.search(r"^compare-all:.*\n((?:\t.*\n)+)", (Path(__file__).parents[1] / "Makefile").read_text(), re.M)
    assert recipe, "no target compare-all"
    assert re.findall(r"-m (\S+)", recipe[1]) == ["baselines.scenarios.tune", "agents.standing"]


def test_a_flight_is_kept_until_what_it_depends_on_changes(tmp_path):
    task = named(CELL, "sine")
    assert task.kept(tmp_path) is None
    found = task.run(tmp_path)
    assert task.kept(tmp_path) == found
    assert named(CELL, "sine").kept(tmp_path) == found, "the same question, asked again"
    assert named(CELL, "sine", Episodes(split="validation", count=3, oracle=0, cost=0.01)).kept(tmp_path) is None
    assert named(CELL, "sine", Episodes(split="tuning", count=2, oracle=0, cost=0.01)).kept(tmp_path) is None
    task.file(tmp_path).write_text("{")
    assert task.kept(tmp_path) is None, "damaged"


def test_scores_are_those_of_the_flight(tmp_path):
    settings, policy = tune.tuned("tight", "microsat")["sine"]
    flight = flown(CELL, policy, seeds("validation", 2))
    task = named(CELL, "sine")
    result = task.run(tmp_path)["result"]
    assert task.settings == settings
    for name in ("expected", "error", "nees"):
        np.testing.assert_allclose(result[name], getattr(flight, name), rtol=1e-4)
    own = row(task, {"revision": "r", "result": result}, 0.01)
    assert own["expected"] == pytest.approx(flight.expected.mean(), rel=1e-4)
    assert own["inside"] == flight.inside(0.01)


def test_the_seconds_after_a_step_are_not_in_the_nees():
    """They are in info, and large: what the filter has believed is no longer true. Of a body at rest none passes."""
    _, policy = tune.tuned("tight", "microsat")["one_step"]
    cell = Cell(scenario="tight", satellite="microsat", inertia="step")
    env = SatInertiaIDVectorEnv(4, "microsat", "step", "tight", control="rate")
    policy.reset(only_mission(env.problem), range(4))
    observation, _ = env.reset(seed=seeds("validation", 4))
    kept, turned = [[] for _ in range(4)], np.zeros(4)
    for _ in range(env.problem.scenario.decisions):
        observation, _, _, _, info = env.step(policy(observation))
        plants, limit = env.fleet.rows.plants, SATELLITES["microsat"].rate_limit
        turns = np.abs(plants["rate"]).max(axis=1) > 0.1 * limit
        turned += env.problem.scenario.decision_period * (turns & (plants["time"] >= plants["law_time"]))
        for i, after in enumerate(plants["time"] - plants["law_time"]):
            if after < 0.0 or turned[i] > 10.0:
                kept[i].append(info["nees"][i])
    np.testing.assert_allclose(flown(cell, policy, seeds("validation", 4)).nees, [np.mean(k) for k in kept], rtol=1e-9)


def test_every_scenario_has_its_ladder():
    for scenario in tune.JUDGED:
        names = [t.name for t in tasks_of(Cell(scenario=scenario, satellite="microsat", inertia="static"), FEW, [])]
        assert set(names) > {"zero", "random", "sine", "rate_square"}
        assert {"mpc", "filter_mpc"} & set(names), "a planner"
        assert (BOUND in names) == (scenario in ("default", "tight", "wheels4")), scenario
        assert ORACLE not in names, "no episodes were asked of it"


def test_learned_policies_fly_where_they_fit():
    assert misfit(find("universal"), CELL) == ""
    assert "observation" in misfit(find("stargazer"), CELL)
    calibration = Cell(scenario="calibration", satellite="microsat", inertia="static")
    assert misfit(find("stargazer"), calibration) == ""


# settings of the rivals


def test_shipped_settings_are_of_the_grid():
    for entry in tune.stored(tune.TUNED):
        assert entry["settings"] in [own for own, _ in rivals(entry["scenario"])[entry["policy"]]]


def test_who_is_not_tuned_is_refused_with_the_command(tmp_path):
    with pytest.raises(
        ValueError, match=r"not tuned for satellite 'innocube'.* --satellites innocube --policies one_step"
    ):
        tune.tuned("tight", "innocube")
    entries = [e | {"settings": {"amplitude": 0.123}} for e in tune.stored(tune.TUNED)]
    (tmp_path / "tuned.json").write_text(json.dumps({"entries": entries}))
    with pytest.raises(ValueError, match=r"one_step is not tried with .*0\.123.* --policies one_step --again"):
        tune.tuned("tight", "microsat", tmp_path / "tuned.json")


def test_tuning_goes_on_where_it_was(tmp_path, monkeypatch, capsys):
    file = tmp_path / "tuned.json"
    few = {name: rivals("tight")[name][-2:] for name in ("sine", "chirp", "zero")}
    monkeypatch.setattr(tune, "rivals", lambda scenario: few)
    line = f"--scenarios tight --satellites microsat --episodes 1 --output {file}"
    asked = []
    best = tune.best
    monkeypatch.setattr(tune, "best", lambda *place: asked.append(place[:3]) or best(*place))
    assert run(monkeypatch, tune, f"{line} --policies sine") == 0
    assert run(monkeypatch, tune, line) == 0
    assert asked == [("tight", "microsat", name) for name in ("sine", "chirp")], "the sine not again, zero never"
    entries = json.loads(file.read_text())["entries"]
    assert [(entry["cost"], entry["episodes"]) for entry in entries] == [(0.01, 1)] * 2
    capsys.readouterr()
    for option, known in (("--cost 0.05", "cost = 0.01"), ("--episodes 2", "episodes = 1")):
        assert run(monkeypatch, tune, f"{line} {option}") == 2
        assert f"{file} was flown with {known}: give another --output, or --again" in capsys.readouterr().err
    assert len(asked) == 2
    assert run(monkeypatch, tune, f"{line} --policies sine --cost 0.05 --again") == 0
    assert {entry["policy"]: entry["cost"] for entry in json.loads(file.read_text())["entries"]} == {
        "sine": 0.05, "chirp": 0.01
    }  # fmt: skip
    assert run(monkeypatch, tune, f"{line} --policies nobody") == 2
    assert "nobody" in capsys.readouterr().err


# the ladder


def entry(policy, kind, inertia, expected, *, inside=True, cost=0.0):
    place = {"satellite": "s", "inertia": inertia, "revision": "r", "settings": {}, "episodes": 2}
    scores = {"expected": expected, "nees": 1.0, "cost": cost, "inside": inside, "decision_ms": 1.0}
    return {"scenario": "tight", "policy": policy, "kind": kind, **place, **scores}


def test_the_best_of_a_kind_is_inside_in_every_cell():
    rows = [
        entry("zero", "reference", "static", 1.0),
        entry("zero", "reference", "step", 1.0),
        entry("sine", "scripted", "static", 0.04),
        entry("sine", "scripted", "step", 0.02),
        entry("chirp", "scripted", "static", 0.01),
        entry("chirp", "scripted", "step", 0.01, inside=False),
        entry("rate_square", "closed_loop", "static", 0.01),
        entry("rate_square", "closed_loop", "step", 0.02),
        entry("random", "reference", "static", 1e-4, inside=False),
        entry("random", "reference", "step", 1e-4, inside=False),
        entry("mpc", "closed_loop", "static", 0.005),
        entry("mpc", "closed_loop", "step", None, inside=False),
        entry("net", "learned", "static", 0.001),  # it does not fly the other cell
        entry(ORACLE, ORACLE, "static", 0.004),
        {**entry(BOUND, BOUND, "static", None), "error": 0.001},
    ]
    found = {step["rung"]: step for step in ladder(rows)}
    assert {rung: step["policy"] for rung, step in found.items()} == {
        "reference": "zero",
        "scripted": "sine",
        "law": "rate_square",
        "planner": "mpc",
        ORACLE: ORACLE,
    }
    assert found["scripted"]["expected"] == pytest.approx(0.04 * 0.5**0.5), "geometric mean"
    assert found["planner"]["expected"] is None
    assert found["law"]["over_best"] == 1.0
    assert found["scripted"]["over_best"] == pytest.approx(2.0)
    assert found[ORACLE]["over_best"] == pytest.approx(0.4), "the oracle is no contender, and is compared where it flew"
    (asked,) = summary.named(rows, ["net", "who"], list(found.values()))
    assert (asked["policy"], asked["cells"], asked["over_best"]) == ("net", 1, pytest.approx(0.1)), "who did not fly"
    assert pair(list(found.values())) == ["rate_square"], "the planner ended early, nothing learned flies here"
    results = {
        "rows": rows,
        "settings": {"scenarios": ["tight"], "satellites": ["s"], "inertias": ["a", "b"], "episodes": 2, "oracle": 0},
        "seeds": {"split": "test"},
        "command": "python -m agents.standing",
    }
    text = ladders_table(results)
    (line,) = (line for line in text.splitlines() if line.startswith("| `"))
    assert line.split(" | ")[:2] == ["| `tight`", "s"]
    assert "python -m agents.standing" in text, "the table says how it was made"
    assert "**`rate_square` 1.41 (1.00)**" in text
    assert "`mpc`\\* ended early" in text


def test_a_flight_that_ends_early_is_the_shorter_one_of_a_replay():
    cell = Cell(scenario="flex", satellite="microsat", inertia="static")
    steps = [
        {"rung": rung, "policy": name, "cells": 1, "inside": 1, "expected": 0.1}
        for rung, name in (("law", "zero"), ("planner", "random"))
    ]
    for seed in seeds("validation", 8):
        shown = replay(cell, tasks_of(cell, FEW, []), steps, seed)
        full, short = (len(flight["error"]) for flight in shown["flights"])
        if short < full:
            break
    assert short < full == len(shown["time"]) == len(shown["inertia"][0])
    assert shown["shown"] == ["zero", "random"]
    assert max(abs(d) for d in shown["flights"][1]["deflection"][0]) > 3.0, "why it ended, in limits"


# the command


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--scenarios nowhere", "nowhere"),
        ("--episodes 1", "episodes"),
        ("--episodes 2 --oracle 3", "oracle"),
        ("--policies generalist", "'generalist' is taken"),
        (f"--policies mpc={RATE_PRETRAINED / 'tank_tour'}", "'mpc' is taken"),
    ],
)
def test_bad_settings_are_refused(line, said, monkeypatch, capsys):
    assert run(monkeypatch, standing, line) == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_the_page_in_a_browser(browser, tmp_path, monkeypatch, capsys):
    cells = "--scenarios tight operations --satellites microsat --inertias static"
    line = f"{cells} --episodes 2 --split validation --output {tmp_path}"
    assert run(monkeypatch, standing, line + " --no-planners") == 0
    printed = capsys.readouterr().out
    assert "tight: expected error" in printed
    assert "operations: expected error" in printed
    results = json.loads((tmp_path / "standing.json").read_text())
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "flights").rglob("*.json")}
    assert run(monkeypatch, standing, line + " --no-planners") == 0
    assert times == {path: path.stat().st_mtime_ns for path in (tmp_path / "flights").rglob("*.json")}, "all kept"

    complaints = []
    page = browser.new_page()
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((tmp_path / "standing.html").as_uri())
    page.wait_for_selector("#episode-charts .main-svg")
    assert page.locator("#ladder tbody tr").count() == 2
    shown = page.locator("#policy-table tbody tr").count()
    assert shown == len([r for r in results["rows"] if r["scenario"] == "tight"])
    page.locator("#ladder button", has_text="operations").click()
    page.wait_for_selector("canvas.sky")
    assert page.locator("#scenario").input_value() == "operations"
    pixels = "c => [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data].filter(v => v).length"
    assert page.locator("canvas.sky").first.evaluate(pixels) > 1000, "the sky is drawn"
    page.locator("#scrub").fill("120")
    assert page.locator("#clock").inner_text().startswith("120.0")
    page.locator("#policy-table thead button", has_text="NEES").click()
    nees = [
        float(t.split()[0])
        for t in page.locator("#policy-table tbody tr td:nth-child(5)").all_inner_texts()
        if t.strip()
    ]
    assert nees == sorted(nees)
    assert complaints == []
    page.close()


def test_what_looking_ahead_gains_by_hand():
    """Two satellites, two inertia modes; on the second satellite an episode of the tour ended early."""
    policies = {
        "lookahead": ("learned", 0.01, 0.5, (2e-4, 8e-4, 3e-4, 3e-4)),
        "tank_tour": ("learned", 0.0, 1.0, (4e-4, 16e-4, 3e-4, None)),
        "filter_mpc": ("closed_loop", 0.0, 1.0, (1e-4, 4e-4, 6e-4, 6e-4)),
        "shaped_square": ("closed_loop", 0.0, 1.0, (8e-4, 8e-4, 4e-4, 4e-4)),
        "spared_square": ("closed_loop", 0.0, 1.0, (9e-4, 9e-4, 3e-4, 3e-4)),
    }
    shared = {"scenario": "flex", "settings": {"policy": "tank_tour"}, "revision": "r"}
    rows = [
        {**shared, "satellite": s, "policy": name, "kind": kind, "nees": nees, "cost": cost, "expected": error}
        for name, (kind, cost, nees, errors) in policies.items()
        for s, error in zip("aabb", errors, strict=True)
    ]
    lines = lookahead_table({"rows": rows, "settings": {"episodes": 8}, "command": "c"}).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:5]]
    assert [own[1:7] for own in cells] == [
        ["all", "0.0346", "`tank_tour` ended early", "1.00", "-", "`spared_square` 0.67"],
        ["a", "0.04", "`tank_tour` 0.50", "2.00", "-", "`shaped_square` 0.50"],
        ["b", "0.03", "`tank_tour` ended early", "0.50", "-", "`spared_square` 1.00"],
    ]
    assert [own[7:] for own in cells] == [["0.50 to 0.50", "1.00"]] * 3
