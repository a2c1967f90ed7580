"""Figures and short tables of the pages: drawn from results made by hand, and from the committed ones."""

import csv
import io
import json

from PIL import Image

from agents.docs import decision_figure, faults_table, limits_figure, readme
from tests.cases import cases

CELLS = [("s", "static"), ("s", "step")]


def comparison():
    """Two cells: zero has twice and four times the generalist's error, whose efficiency is 0.5 and 0.8."""
    errors = {"generalist": (0.01, 0.02), "zero": (0.02, 0.08), "sine": (0.015, 0.05)}
    kinds = {"generalist": "learned", "zero": "reference", "sine": "scripted"}
    records = [
        {
            "policy": policy,
            "kind": kinds[policy],
            "satellite": satellite,
            "inertia_mode": mode,
            "final_error_mean": errors[policy][i],
            "outside_fraction": 0.5 if (policy, mode) == ("sine", "static") else 0.0,
            "saturated_fraction": 0.0,
        }
        for i, (satellite, mode) in enumerate(CELLS)
        for policy in errors
    ]
    place = [{"satellite": satellite, "inertia_mode": mode} for satellite, mode in CELLS]
    bounds = [
        {**place[i], "policy": name, "final_error": 0.001} for i in (0, 1) for name in ("bound", "reference_limit")
    ]
    efficiencies = [
        {**place[i], "policy": "generalist", "excitation_efficiency": share} for i, share in ((0, 0.5), (1, 0.8))
    ]
    head = {"revision": "r", "command": "python -m agents.compare --output x", "pairs": []}
    return {**head, "records": records, "bounds": bounds, "efficiencies": efficiencies}


def test_shares_by_hand():
    lines = limits_figure.share_table(comparison()).splitlines()
    assert lines[2] == "| generalist | 2 to 4 | 50 to 80 |"
    assert lines[-1] == "Revision r, python -m agents.compare."


def test_only_profiles_inside_the_envelope_are_drawn():
    eight = [point for point in limits_figure.points(comparison()) if point[2] == "best of the paper's eight"]
    assert eight == [("s", "step", "best of the paper's eight", 0.05)]


def test_the_figure_of_the_limits_is_of_the_committed_results(tmp_path):
    results = json.loads((readme.RESULTS / "compare.json").read_text(encoding="utf-8"))
    limits_figure.draw(results, tmp_path / "limits.png")
    with Image.open(tmp_path / "limits.png") as drawn, Image.open(readme.ROOT / "docs/media/limits.png") as committed:
        assert drawn.info["Source"] == committed.info["Source"], "run python -m agents.docs.limits_figure"
        assert min(drawn.size) > 300


def test_the_diagram_of_a_decision_can_be_drawn_twice_the_same(tmp_path):
    for name in ("a.svg", "b.svg"):
        decision_figure.draw(tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_the_flow_of_a_decision_enters_belief_by_the_sensors_alone():
    """Boxes of truth lie left of the wall, those of belief right of it."""
    truth = {"wheels", "body", "sensors", "world", "info"}
    wall = 8.87
    assert {name for name, (x, *_) in decision_figure._BOXES.items() if x < wall} == truth


def study():
    row = {"satellite": "microsat", "policy": "generalist", "recovery_s": None, "recovery_s_95": None}
    row |= {"nees_worst": 1.0, "terminated": 0.0, "nees_during": 7.0}
    figures = {"ungated": (0.5, 23456.0, 0.2), "gated": (0.00123, 0.654, 0.0031)}
    keys = ("final_error", "nees_after", "outside")
    records = [
        {**row, "case": case, "filter": kind, **dict(zip(keys, values, strict=True))}
        for case in faults_table.CASES
        for kind, values in figures.items()
    ]
    return {"revision": "r", "records": records}


def test_the_short_table_of_faults_is_made_of_the_csv(tmp_path, monkeypatch):
    text = faults_table.csv_text(study())
    rows = list(csv.DictReader(io.StringIO(text)))
    assert (rows[0]["recovery_s"], rows[0]["revision"], "nees_during" in rows[0]) == ("", "r", False)
    monkeypatch.setattr(faults_table, "FILE", tmp_path / "faults.csv")
    (tmp_path / "faults.csv").write_text(text, encoding="utf-8")
    lines = faults_table.short_table().splitlines()
    assert lines[2] == "| none | 50 / 0.12 | 2e4 / 0.65 | 20 / 0.31 |"
    assert len(lines) == 2 + len(faults_table.CASES) + 2


def test_the_committed_study_has_every_case_of_the_short_table():
    with faults_table.FILE.open(encoding="utf-8", newline="") as file:
        found = {(row["case"], row["filter"]) for row in csv.DictReader(file) if row["policy"] == faults_table.POLICY}
    assert found >= {(case, kind) for case in faults_table.CASES for kind in ("ungated", "gated")}


@cases(("text", "shown"), [("", "-"), ("0.5", "0.5"), ("123.4", "120"), ("1e5", "1e5")])
def test_numbers_of_the_short_table(text, shown):
    assert faults_table._number(text, 1.0) == shown
