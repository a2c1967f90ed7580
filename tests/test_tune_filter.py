"""The study of the AdaptiveEKF's settings: it filters what was flown, and compares like with like."""

from __future__ import annotations

import json

import numpy as np
import pytest

from baselines.command.cli import exit_code
from baselines.studies.recording import record
from baselines.tuning import filter_sensitivity
from satid_gym import metrics
from satid_gym.evaluation import benchmark_scenario, seeds
from satid_gym.policies.registry import make_baseline


@pytest.mark.compiled
def test_readings_filtered_again_give_what_the_environments_filter_gave():
    flown = record(
        make_baseline("rate_square", "microsat"),
        satellite="microsat",
        inertia="step",
        seeds=seeds("tuning", 2),
        scenario=benchmark_scenario(),
    )
    truth = np.diagonal(flown.motion.inertia, axis1=2, axis2=3)
    error = np.linalg.norm(flown.theta - truth, axis=2) / np.linalg.norm(truth, axis=2)
    found = filter_sensitivity.filtered({}, "microsat", flown, "step")
    assert found["final_error"] == pytest.approx(metrics.final_error(error.T).mean(), rel=1e-6)
    assert found["mean_error"] == pytest.approx(metrics.mean_error(error.T).mean(), rel=1e-6)
    assert 0.2 < found["nees"] < 2.0
    other = filter_sensitivity.filtered({"inertia_walk": 0.02, "inertia_walk_min": 0.02}, "microsat", flown, "step")
    assert other["final_error"] > 2.0 * found["final_error"]


def test_each_setting_is_halved_and_doubled_by_itself():
    default, *others = filter_sensitivity.variants()
    assert default == {}
    assert [list(each) for each in others] == [[name] for name in filter_sensitivity.VARIED for _ in range(2)]


def test_a_score_is_compared_cell_by_cell():
    records = [
        {"settings": settings, "inertia_mode": mode, "final_error": error}
        for mode in ("static", "step")
        for settings, errors in (({}, (1.0, 100.0)), ({"log_q_drift": 0.1}, (2.0, 800.0)))
        for error in errors
    ]
    assert filter_sensitivity.relative(records, {"log_q_drift": 0.1}, "static", "final_error") == pytest.approx(4.0)


@pytest.mark.compiled
def test_the_command_writes_every_variant_of_every_cell(tmp_path, monkeypatch, capsys):
    line = ["tune_filter.py", "--episodes", "1", "--satellites", "microsat", "--policies", "prbs"]
    monkeypatch.setattr("sys.argv", [*line, "--output", str(tmp_path / "study.json")])
    assert exit_code(filter_sensitivity.main) == 0
    records = json.loads((tmp_path / "study.json").read_text())["records"]
    assert len(records) == 4 * len(filter_sensitivity.variants())
    assert "log_q_drift 0.1" in capsys.readouterr().out
