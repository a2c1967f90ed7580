"""The verdict on learned policies, with numbers worked out by hand."""

import json
import shutil
import sys

import pytest

from agents.benchmark import acceptance
from agents.benchmark.acceptance import CLOSED_LOOPS, UNSEEN, benchmark_claims, needed_efficiency, tight_claims
from agents.docs.readme import RESULTS
from baselines.command.cli import exit_code
from satid_gym import SATELLITES
from satid_gym.policies import BASELINES, make_baseline
from satid_gym.profiles import PROFILES
from tests.cases import cases


def record(policy, kind, final, mean=None, **changes):
    values = {
        "policy": policy,
        "kind": kind,
        "satellite": "s",
        "inertia_mode": "static",
        "final_error_mean": final,
        "final_error_lo": 0.9 * final,
        "final_error_hi": 1.1 * final,
        "mean_error_mean": final if mean is None else mean,
        "time_to_1pct_s": 1.0,
        "outside_fraction": 0.0,
        "terminated_fraction": 0.0,
        "saturated_fraction": 0.0,
        "nees": 1.0,
    }
    return values | changes


def cell(**changes):
    eight = [record(name, "scripted", 0.012) for name in PROFILES]
    return [*eight, record("square", "closed_loop", 0.005), record("own", "learned", 0.003, 0.002) | changes]


def results(records, *, behind=-0.001):
    """Results of one cell, in which the learned policy differs from the closed loop by `behind` or more."""
    pair = {"policy": "own", "other": "square", "satellite": "s", "inertia_mode": "static", "difference_lo": behind}
    return {
        "records": records,
        "pairs": [pair, {**pair, "other": "sine", "difference_lo": 1.0}],
        "efficiencies": [
            {"policy": "own", "excitation_efficiency": 0.8},
            {"policy": "square", "excitation_efficiency": 0.5},
        ],
    }


def held(claims):
    return {asked: holds for asked, _, holds in claims}


def test_a_policy_that_does_all_that_is_asked_holds():
    assert all(held(benchmark_claims(results(cell()), "own")).values())


@cases(
    ("changes", "broken"),
    [
        ({"final_error_mean": 0.0041}, ["final error over the best of the eight, at most 1/3"]),
        ({"final_error_hi": 0.011}, ["... with intervals apart, in all cells"]),
        ({"mean_error_mean": 0.0025}, ["mean error over the best of the eight, at most 1/5"]),
        ({"time_to_1pct_s": None}, ["median time to 1 %, at most 3 s"]),
        ({"outside_fraction": 0.02}, ["share of time outside, at most 1 %; none ended"]),
        ({"nees": 2.5}, ["NEES between 0.3 and 2"]),
    ],
)
def test_each_claim_breaks_alone(changes, broken):
    claims = held(benchmark_claims(results(cell(**changes)), "own"))
    assert [asked for asked, holds in claims.items() if not holds] == broken


def test_profiles_outside_the_envelope_do_not_count_while_one_is_inside():
    records = cell()
    records[0] |= {"final_error_mean": 0.004, "outside_fraction": 0.5}
    assert all(held(benchmark_claims(results(records), "own")).values())


def test_a_closed_loop_that_is_better_is_seen():
    records = cell()
    records[8] |= {"final_error_mean": 0.002}
    claims = held(benchmark_claims(results(records), "own"))
    assert not claims["final error over the best closed loop, at most 1"]
    assert not claims["better in both, in at least half of the cells"]
    clear = "cells where a closed loop is better beyond the paired interval"
    assert claims[clear]  # by what chance may do
    assert not held(benchmark_claims(results(records, behind=0.0001), "own"))[clear]


def test_what_a_third_would_take():
    # a quarter of the best profile's error at 0.8 of the limit: three quarters of that for a third
    assert needed_efficiency(results(cell()), "own") == [pytest.approx(0.6)]


def test_saturated_wheels_are_seen():
    claims = held(tight_claims(results(cell(saturated_fraction=0.02)), "own"))
    assert list(claims.values()) == [True, False]


def test_a_profile_that_holds_wheels_at_their_limit_is_not_the_best():
    records = cell()
    records[0] |= {"final_error_mean": 0.004, "saturated_fraction": 0.5}
    assert list(held(tight_claims(results(records), "own")).values()) == [True, True]
    records[0] |= {"saturated_fraction": 0.01}
    assert list(held(tight_claims(results(records), "own")).values()) == [False, True]


def test_the_unseen_satellite_lies_between_those_trained_on():
    small, large = SATELLITES["cubesat"], SATELLITES["smallsat"]
    for i in range(3):
        assert small.inertia[i, i] < UNSEEN.inertia[i, i] < large.inertia[i, i]
    assert small.wheels.max_torque[0] < UNSEEN.wheels.max_torque[0] < large.wheels.max_torque[0]
    assert large.rate_limit < UNSEEN.rate_limit < small.rate_limit


def test_the_rivals_are_the_closed_loops_of_the_registry():
    kinds = {name: make_baseline(name, "cubesat").kind for name in BASELINES}
    assert {name for name, kind in kinds.items() if kind == "closed_loop"} == set(CLOSED_LOOPS)


# the command, on results that are not whole


def judge(folder, capsys, monkeypatch):
    """Exit code and standard error of `python -m agents.verdict --results FOLDER`; nothing may be flown."""

    def flown(*_, **__):
        raise AssertionError("work had begun")

    monkeypatch.setattr(acceptance, "fly", flown)
    monkeypatch.setattr(sys, "argv", ["verdict", "--results", str(folder)])
    code = exit_code(acceptance.main)
    return code, capsys.readouterr().err


def kept(tmp_path, keep, *tables, name="compare"):
    """A folder with the committed results, of whose tables (all where none is named) rows are left out."""
    whole = json.loads((RESULTS / f"{name}.json").read_text())
    for table in tables or ("records", "pairs", "bounds", "efficiencies"):
        whole[table] = [row for row in whole[table] if keep(row)]
    if name != "compare":
        shutil.copy(RESULTS / "compare.json", tmp_path)
    (tmp_path / f"{name}.json").write_text(json.dumps(whole))
    return tmp_path


@cases(
    ("keep", "lacks"),
    [
        (lambda r: r["policy"] not in ("one_step", "mpc"), "needs, policies one_step, mpc: "),
        (lambda r: r["policy"] != "generalist", "needs, policies generalist: "),
        (lambda r: (r["satellite"], r["inertia_mode"]) != ("cubesat", "drift"), "needs, cells cubesat/drift: "),
        (lambda r: (r["policy"], r["inertia_mode"]) != ("greedy", "step"), "needs, policies greedy: "),
    ],
)
def test_a_smaller_comparison_is_refused_with_what_is_missing(keep, lacks, tmp_path, capsys, monkeypatch):
    code, errors = judge(kept(tmp_path, keep), capsys, monkeypatch)
    assert code == 2
    assert errors.count("\n") == 1
    assert lacks in errors
    assert errors.endswith(f"run python -m agents.compare --all --scenario default --output {tmp_path}\n")


@cases(
    ("table", "lacks"),
    [
        ("pairs", "pairs of a judged policy with a closed loop"),
        ("efficiencies", "efficiencies of a judged policy"),
    ],
)
def test_results_without_what_belongs_to_a_policy_are_refused(table, lacks, tmp_path, capsys, monkeypatch):
    folder = kept(tmp_path, lambda r: r["policy"] != "generalist", table)
    code, errors = judge(folder, capsys, monkeypatch)
    assert (code, errors.count("\n")) == (2, 1)
    assert f"needs, {lacks}: run" in errors


def test_a_smaller_comparison_in_the_tight_scenario_is_refused_too(tmp_path, capsys, monkeypatch):
    folder = kept(tmp_path, lambda r: r["policy"] != "chirp", name="compare_tight")
    code, errors = judge(folder, capsys, monkeypatch)
    assert (code, errors.count("\n")) == (2, 1)
    assert "compare_tight.json lacks what the verdict needs" in errors
    assert "needs, policies chirp: run python -m agents.compare --scenario tight" in errors


DAMAGED = {
    "records": [5, None, [5], [{}], {"policy": "sine"}],
    "pairs": ["none", [[]]],
    "efficiencies": [True, [{"policy": 1}]],
}


@cases(("name", "value"), [(name, value) for name, values in DAMAGED.items() for value in values])
def test_damaged_results_are_refused_in_a_line(name, value, tmp_path, capsys, monkeypatch):
    whole = json.loads((RESULTS / "compare.json").read_text())
    (tmp_path / "compare.json").write_text(json.dumps({**whole, name: value}))
    code, errors = judge(tmp_path, capsys, monkeypatch)
    assert (code, errors.count("\n")) == (2, 1)
    assert "compare.json is damaged: " in errors
    assert name in errors


@cases("value", ["much", None, True, "10**400", float("nan")])
def test_a_score_that_is_no_number_is_refused_with_its_place(value, tmp_path, capsys, monkeypatch):
    whole = json.loads((RESULTS / "compare.json").read_text())
    whole["records"][7]["final_error_mean"] = 10**400 if value == "10**400" else value
    (tmp_path / "compare.json").write_text(json.dumps(whole))
    code, errors = judge(tmp_path, capsys, monkeypatch)
    assert (code, errors.count("\n")) == (2, 1)
    assert "final_error_mean in row 7 of records must be a finite number" in errors
